"""How long the contact sticks."""
