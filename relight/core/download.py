"""Packages of the npm registry that a set-up command fetches once, pinned by version and hash."""

import base64
import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from relight.core.errors import UserError
from relight.core.files import existing_file

REGISTRY = "https://registry.npmjs.org"
TIMEOUT = 60  # seconds without an answer of the registry


@dataclass(frozen=True)
class Package:
    """A version of a package.

    Attributes:
        name: such as "onnxruntime-web" or "@scope/name".
        version: such as "1.30.0".
        integrity: SHA-512 of its .tgz file in base64, as the registry states it after "sha512-".
        command: that sets it up, such as "relight web setup".
    """

    name: str
    version: str
    integrity: str
    command: str

    @property
    def file_name(self) -> str:
        """The name of the file that `npm pack` writes."""
        return f"{self.name.removeprefix('@').replace('/', '-')}-{self.version}.tgz"


def fetch(package: Package, file: Path | str | None = None) -> bytes:
    """Returns a package, its .tgz, from a file or else by a download.

    It comes from the registry, or from the one that the variable NPM_CONFIG_REGISTRY names, as for npm.

    Raises:
        UserError: if it cannot be had, or its hash is not that of the package.
    """
    if file is not None:
        data = existing_file(file, "--from").read_bytes()
    else:
        import urllib.request  # a photo needs none of it
        from http.client import HTTPException

        registry = os.environ.get("NPM_CONFIG_REGISTRY") or REGISTRY
        address = f"{registry.rstrip('/')}/{package.name}/-/{package.name.split('/')[-1]}-{package.version}.tgz"
        try:
            with urllib.request.urlopen(address, timeout=TIMEOUT) as answer:
                data = bytes(answer.read())
        except (OSError, ValueError, HTTPException) as error:  # urllib's errors are OSErrors
            raise UserError(
                f"{package.name} {package.version} could not be downloaded ({getattr(error, 'reason', error)}): run "
                f"`npm pack {package.name}@{package.version}` where there is a network, then `{package.command} --from "
                f"{package.file_name}`"
            ) from None
    if base64.b64encode(hashlib.sha512(data).digest()).decode() != package.integrity:
        raise UserError(f"{file or package.file_name} is not {package.name} {package.version}: its SHA-512 differs")
    return data
