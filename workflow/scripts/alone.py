"""`alone.py FILE command...` runs a command while it holds a lock on FILE, so that two `make` do not install at once.

The command and its children inherit the lock, which is released when all of them have ended. Standard library only.
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
        print("another make is installing in this folder: waiting for it", flush=True)
        fcntl.flock(handle, fcntl.LOCK_EX)
    os.set_inheritable(handle, True)
    os.execvp(command[0], command)


if __name__ == "__main__":
    main()
