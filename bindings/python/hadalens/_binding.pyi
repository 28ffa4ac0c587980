# What cdef.py makes from the public headers: every function, struct and constant of the C interface.
from typing import Any

ffi: Any
lib: Any
