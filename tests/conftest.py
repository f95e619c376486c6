import os
import tempfile

# A kernel cached on disk does not notice an edited helper, so every test run compiles its own.
_cache = tempfile.TemporaryDirectory(prefix="flipcar-numba-")
os.environ["NUMBA_CACHE_DIR"] = _cache.name
