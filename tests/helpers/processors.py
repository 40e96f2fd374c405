"""Environments in which Numba compiles for another processor than this one."""

# AVX2 without AVX-512: LLVM's list of what its "haswell" has. Numba would else add what this processor has more.
_HASWELL = (
    "64bit avx avx2 bmi bmi2 cmov crc32 cx16 cx8 f16c fma fsgsbase fxsr invpcid lzcnt mmx movbe pclmul popcnt "
    "rdrnd sahf sse sse2 sse3 sse4.1 sse4.2 ssse3 xsave xsaveopt"
)
VARIABLES = {
    "haswell": {
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": ",".join(f"+{name}" for name in _HASWELL.split()),
    },
    # The least that a processor of 64 bits has: SSE2.
    "generic": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
}
