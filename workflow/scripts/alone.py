"""`alone.py FILE command...` runs a command once no other holds FILE, so that two `make` do not install at once.

The command inherits the lock: it is free as soon as the command and all that it started have ended. Standard library
only.
"""

import fcntl
import os
import sys


def main() -> None:
    path, *command = sys.argv[1:]
    handle = os.open(path, os.O_RDWR)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print("another make installs in this folder: waiting for it", flush=True)
        fcntl.flock(handle, fcntl.LOCK_EX)
    os.set_inheritable(handle, True)
    os.execvp(command[0], command)


if __name__ == "__main__":
    main()
