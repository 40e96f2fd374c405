"""How the paper's three flutter onsets follow the numbers of the rig."""
