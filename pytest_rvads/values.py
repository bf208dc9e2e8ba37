"""The classes of values that are parts of runs, junctions and rules, or that functions take or return.

A test reads such values without their classes. Annotations, and code that makes a `Run`, need the classes. The names stand in
``values.pyi``.
"""

from pytest_rvads.support.lazy import public_names

__getattr__, __dir__ = public_names(__name__)
