"""How a study is asked: a request becomes points, they a sweep, and each batch a call of its function."""
