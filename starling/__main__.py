"""`python -m starling VERB` is the same as `starling VERB`."""

import sys

from starling.command_line import main

if __name__ == "__main__":
    sys.exit(main())
