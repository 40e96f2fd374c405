"""Numbers printed in the paper, with the sections where they appear.

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

# Table 2: the load (N) and the speeds (m/s) of the tests.
LOAD = 9.0
SPEEDS = (1e-3, 2e-3, 5e-3)

# Section 2, Fig. 3: peaks of the measured spectra (Hz), the dominant one with its harmonics, and others.
LINES = (2700.0, 5400.0, 8100.0)
OTHER_LINES = (2080.0, 6500.0)

# Section 3.5.3: the dominant frequency of the simulated spectra, Hz.
SIMULATED_LINE = 2700.0

# Sections 2 and 3.5.3, Figs. 2 and 7: kind of vibration by speed (m/s).
VIBRATION = {1e-3: "intermittent", 2e-3: "intermittent", 5e-3: "periodic"}

# Section 3.5.4.2: mean duration of the sticking phases at 2 mm/s over that at 1 mm/s.
STICK_RATIO = 0.5
STICK_RATIO_SPEEDS = (2e-3, 1e-3)

# Sections 3.5.4.1 and 3.5.4.2: what the normal force (N) and the slip speed (m/s) can reach, by speed (m/s).
CONTACT_PEAKS = {5e-3: (25.0, 0.030), 2e-3: (50.0, 0.120)}

# Section 3.6, Fig. 11: speed (m/s), and by inclination (degrees) the measured frequency (Hz), NaN where stable.
ANGLES_SPEED = 2e-3
ANGLES = {10.0: 2700.0, 15.0: float("nan")}

# Table 6, whose body is not available: what the text says of single inclinations (degrees) at mu = 0.2 and F = 9
# N. Sections 2 and 3.6: dominant frequency measured at 2 mm/s, Hz.
ANGLES_MEASURED = {5.0: 2700.0, 10.0: ANGLES[10.0]}
# Section 3.5.3: dominant frequency of the simulation, Hz.
ANGLES_SIMULATED = {5.0: 2700.0}
# Section 3.4.2: frequencies of the unstable pairs of the stability analysis, Hz.
ANGLES_UNSTABLE = {5.0: (400.0, 2800.0)}
# Section 3.6: between these angles (degrees), both excluded, it slides steadily.
STEADY_ANGLES = ((float("-inf"), 0.0), (12.0, float("inf")))
