"""Numbers printed in the paper that studies are compared with, and where they stand.

Meziane, Baillet, Laulagnet, Applied Acoustics 71 (2010) 843-853.
"""

# Table 4: frequencies (Hz) of the beams glued at the contact.
GLUED_NUMERICAL = (16.0, 362.0, 1665.0, 2060.0, 2924.0, 5035.0, 6624.0, 8030.0)
GLUED_MEASURED = (16.0, 374.0, 1620.0, 2080.0, 2930.0, 4875.0, 6600.0, 7690.0)

# Section 3.3: the head mass is tuned to this first frequency.
FIRST_GLUED = 16.0

# Section 3.2, the contact; Table 2 and the figures' captions, the operating point.
CONTACT_POSITION = 0.080
THETA = 5.0
MU = 0.2

# Section 3.4.2: (mu, Hz) where two modes coalesce; first unstable values on the paper's grid of mu.
ONSETS = ((0.12, 2800.0), (0.16, 400.0), (0.23, 7700.0))

# Section 3.4.2, Fig. 6a: modes 5 and 6 without friction, Hz.
MODES_5_AND_6 = (2500.0, 3100.0)
