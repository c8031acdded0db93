"""Builds the shared library with the Makefile above, and makes it part of the package."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.build_py import build_py

HERE = Path(__file__).resolve().parent
FILE = {"darwin": "libOpenImageDenoise.2.dylib", "win32": "OpenImageDenoise.dll"}.get(
    sys.platform, "libOpenImageDenoise.so.2")


def version() -> str:
    header = (HERE.parent / "lib" / "lull.h").read_text()
    return ".".join(re.findall(r"#define LULL_VERSION_\w+ (\d+)", header))


class BuildWithLibrary(build_py):
    def run(self) -> None:
        super().run()
        build = os.environ.get("BUILD", "build")  # as make has it
        made = HERE.parent / build / "lib" / FILE
        subprocess.run(["make", f"-j{os.cpu_count() or 1}", f"BUILD={build}",
                        f"{build}/lib/{FILE}"], cwd=HERE.parent, check=True)
        shutil.copy2(made, Path(self.build_lib) / "lull" / FILE)


class OfThisPlatform(Distribution):
    def has_ext_modules(self) -> bool:
        return True


try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:  # before setuptools 70.1
    from wheel.bdist_wheel import bdist_wheel


class AnyPython(bdist_wheel):
    """A wheel for every Python of this platform: nothing in it is built against one."""

    def get_tag(self) -> tuple[str, str, str]:
        return ("py3", "none", super().get_tag()[2])


setup(version=version(), distclass=OfThisPlatform,
      cmdclass={"build_py": BuildWithLibrary, "bdist_wheel": AnyPython})
