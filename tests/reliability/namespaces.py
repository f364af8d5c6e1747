"""Programs with file systems of their own, where this user may mount them."""

import shutil
import subprocess


def mounted(*places: str) -> list[str]:
    """The beginning of a command line in a mount namespace, with a tmpfs at each place: options, "none", folder."""
    mounts = " && ".join(f"mount -t tmpfs {place}" for place in places)
    return ["unshare", "-rm", "sh", "-c", f'{mounts} && exec "$@"', "sh"]


def namespaced() -> bool:
    """Whether this user may mount in a namespace."""
    command = [*mounted("none /mnt"), "true"]
    return bool(shutil.which("unshare")) and not subprocess.run(command, capture_output=True).returncode
