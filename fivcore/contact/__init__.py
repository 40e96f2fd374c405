"""The contact of the reduced model.

`reduced`: kept modes and the element for the others; `ablation`: modifications of such a model; `impulse`: the
correction for impulses; `law`: stick, slip and separation as linear maps; `step_map`: one step as a matrix.
"""
