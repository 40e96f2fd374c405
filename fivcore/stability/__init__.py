"""Linear stability of steady sliding.

`tied` modes, with the contact tied; `exponents` of steady sliding, and `sliding`, its modes; `onsets`,
the certain search for flutter onsets with Rayleigh damping; `sampled`, that for modal damping and for `falling`
friction; `many`, onsets of one rig or structure, or of many rigs; `intervals`, onsets and unstable windows over
theta; `sensitivity`, derivatives of onsets by parameters; `assembled`, modes and onsets of finite-element models
with friction as a matrix.
"""
