"""`python -m bench NAME...` is `crunch bench NAME...` of the checkout in the working directory."""

import sys

from server.__main__ import main

if __name__ == "__main__":
    main(["bench", *sys.argv[1:]])
