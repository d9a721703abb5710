"""`spindoe.compat` under a name that no other file hides.

The SpinDOE authors' folder holds a ``spindoe.py``: a script that lies there, or has the folder on its path, finds that file
where it imports ``spindoe``. This name leads to the package all the same, and leaves theirs to be imported::

    from spindoe_compat import DOE, BayGeoHasher, SpinDOE, SpinRegressor

Where the package can be imported as ``spindoe``, the classes are the same as those of ``spindoe.compat``. Where it cannot, its
modules are loaded as parts of this one.
"""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

_PACKAGE = Path(__file__).parent.with_name("spindoe")


def _is_hidden() -> bool:
    """Whether ``spindoe`` is another module than the package."""
    loaded = sys.modules.get("spindoe")
    spec = None if loaded is not None else find_spec("spindoe")
    origin = getattr(loaded, "__file__", None) if spec is None else spec.origin
    return origin is None or Path(origin).resolve() != (_PACKAGE / "__init__.py").resolve()


if TYPE_CHECKING or not _is_hidden():
    from spindoe.compat import DOE, BayGeoHasher, KeyPoint, SpinDOE, SpinRegressor

    # What was pickled where the package is hidden has its modules as parts of this one.
    for _name in [name for name in sys.modules if name.startswith("spindoe.")]:
        sys.modules[f"{__name__}.{_name.removeprefix('spindoe.')}"] = sys.modules[_name]
else:
    __path__ = [str(_PACKAGE)]
    from .compat import DOE, BayGeoHasher, KeyPoint, SpinDOE, SpinRegressor

__all__ = ["DOE", "BayGeoHasher", "KeyPoint", "SpinDOE", "SpinRegressor"]
