"""pytest-rvads: validate autonomous-driving controllers against traffic rules, in pytest.

The public names stand in ``__init__.pyi`` and are loaded when first used, so that importing the package costs nothing. So are the
marks of tests that other packages add by entry points in the group ``rvads.marks``.
The modules ``errors``, ``files`` and ``values`` hold the public names that few tests write.
"""

from pytest_rvads.support.lazy import public_names

__version__ = "0.3.0"

__getattr__, __dir__ = public_names(__name__, "marks")
