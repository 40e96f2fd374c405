"""Linear stability of steady sliding.

`tied` modes of structures in bonded contact; `exponents` of steady sliding, and `sliding`, its modes; `onsets`,
the certain search for flutter onsets with Rayleigh damping; `sampled`, that for damping by mode and for `falling`
friction; `many`, onsets of one rig or structure, or of many rigs; `intervals`, onsets and unstable windows over
theta; `sensitivity`, derivatives of onsets by parameters; `assembled`, modes and onsets of finite-element models
with friction as a matrix.
"""
