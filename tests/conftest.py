import os
import tempfile

# A kernel cached on disk does not notice an edited helper, so every test run compiles its own; its
# workers inherit the place, and share what they compile.
if "PYTEST_XDIST_WORKER" not in os.environ:
    _cache = tempfile.TemporaryDirectory(prefix="flipcar-numba-")
    os.environ["NUMBA_CACHE_DIR"] = _cache.name
