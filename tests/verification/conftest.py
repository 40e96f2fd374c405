from tests.fivcore.conftest import one_blas_thread  # noqa: F401 - pytest calls it
