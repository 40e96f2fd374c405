"""Linear stability of steady sliding.

`tied` modes of the beams in bonded contact; `secular`, the characteristic equation; `sliding`, its modes;
`onsets`, the search for flutter onsets; `many`, onsets of one rig or of many; `intervals`, onsets and unstable
windows over theta; `sensitivity`, derivatives of onsets by the parameters of the rig.
"""
