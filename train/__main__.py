"""`python -m train` is `flipcar train`."""

import sys

from .cli import main

main(["train", *sys.argv[1:]])
