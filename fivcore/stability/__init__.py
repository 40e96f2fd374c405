"""Linear stability of steady sliding.

`tied` modes of structures in bonded contact; `secular`, the characteristic equation; `sliding`, its modes;
`by_mode`, both for a structure with damping by mode, and `by_mode_onsets` its flutter onsets; `onsets`, the search
for flutter onsets; `many`, onsets of one rig or structure, or of many rigs; `intervals`, onsets and unstable
windows over theta; `sensitivity`, derivatives of onsets by parameters; `assembled`, modes and onsets of
finite-element models with friction as a matrix.
"""
