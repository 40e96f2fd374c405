"""Linear stability of steady sliding.

`tied` modes of the beams in bonded contact; `secular`, the characteristic equation; `sliding`, its modes;
`by_mode`, both for a structure with damping by mode, and `by_mode_onsets` its flutter onsets; `onsets`, the search
for flutter onsets; `many`, onsets of one rig or structure, or of many rigs; `intervals`, onsets and unstable
windows over theta; `sensitivity`, derivatives of onsets by parameters.
"""
