"""Conan's recipe: `conan create .` in a checkout, with CMake; nothing is downloaded.

In CMake, find_package(OpenImageDenoise) and the target OpenImageDenoise, as of Open Image Denoise's
own package: the generator CMakeToolchain is enough. docs/embedding.md has more.
"""

import os
import re

from conan import ConanFile
from conan.errors import ConanInvalidConfiguration
from conan.tools.cmake import CMake, CMakeToolchain, cmake_layout
from conan.tools.files import copy, load, rm

required_conan_version = ">=2.0"


class Lull(ConanFile):
    name = "lull"
    description = "Denoises path-traced images: small, fast, the same bytes everywhere"
    license = "Apache-2.0"
    topics = ("denoising", "path-tracing", "rendering", "openimagedenoise")
    package_type = "library"
    settings = "os", "arch", "compiler", "build_type"
    options = {
        "shared": [True, False],
        "opencl": [True, False],  # OpenCL devices; the library is loaded when one is asked for
        "threads": [True, False],
    }
    default_options = {"shared": False, "opencl": True, "threads": True}
    languages = "C"
    exports_sources = ("CMakeLists.txt", "LICENSE", "apps/sources.mk", "lib/*", "oidn/*", "ports/*",
                       "weights/*")

    def set_version(self):
        header = load(self, os.path.join(self.recipe_folder, "lib", "lull.h"))
        self.version = ".".join(re.findall(r"#define LULL_VERSION_\w+ (\d+)", header))

    def validate(self):
        if self.settings.compiler == "msvc":
            raise ConanInvalidConfiguration("lull is made with GCC or Clang (on Windows: MinGW)")

    def layout(self):
        cmake_layout(self)

    def generate(self):
        toolchain = CMakeToolchain(self)
        toolchain.cache_variables["LULL_APPS"] = False
        toolchain.cache_variables["LULL_OPENCL"] = bool(self.options.opencl)
        toolchain.cache_variables["LULL_THREADS"] = bool(self.options.threads)
        toolchain.generate()

    def build(self):
        cmake = CMake(self)
        cmake.configure()
        cmake.build()

    def package(self):
        """Of the two libraries that CMake installs one stays: linkers would choose by themselves,
        and the CMake package takes the one that there is."""
        CMake(self).install()
        copy(self, "LICENSE", self.source_folder, os.path.join(self.package_folder, "licenses"))
        other = ["libOpenImageDenoise.a"] if self.options.shared else [
            "libOpenImageDenoise.so*", "libOpenImageDenoise*.dylib", "*.dll", "*.dll.a"]
        for pattern in other:
            rm(self, pattern, self.package_folder, recursive=True)

    def package_info(self):
        self.cpp_info.set_property("cmake_find_mode", "none")  # it has a CMake package of its own
        facade = self.cpp_info.components["oidn"]  # the interface of Open Image Denoise
        facade.set_property("pkg_config_name", "OpenImageDenoise")
        facade.libs = ["OpenImageDenoise"]
        facade.builddirs = ["."]  # where CMake looks for it
        if not self.options.shared:
            facade.defines = ["OIDN_STATIC_LIB"]
            if self.settings.os in ("Linux", "FreeBSD"):
                facade.system_libs = ["pthread"] * bool(self.options.threads) + \
                    ["dl"] * bool(self.options.opencl)
        core = self.cpp_info.components["core"]  # lull.h, a static library in any case
        core.set_property("pkg_config_name", "lull")
        core.libs = ["lull"]
