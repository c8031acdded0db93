# lull: the reference build. Needs GNU make and a C99 compiler, nothing else.
#
#   make                the libraries and the tools, in build/
#   make demo           denoises demo/ and says what it did
#   make train-demo     from nothing to a denoiser: scenes, training, export, check (half an hour)
#   make check          every test (as root it installs the Debian packages that they need)
#   make wasm           build/wasm/bin: lull.wasm, lull.mjs, ..., for browsers (clang, lld, llvm-ar, wasi-libc)
#   make amalgamation   build/amalgamation: the core as lull.c and lull.h, to be vendored
#   make install        DESTDIR= prefix=/usr/local libdir= includedir= ... (uninstall: the same settings)
#   make conform        every port of this CPU against the scalar one, and its speed
#   make peer           outputs beside the real Open Image Denoise (Python package pyoidn)
#   make peer-test      its own test program and clients on our library, also sanitized
#   make bench-peer     speed and memory beside it
#   make chart          speed against accuracy: docs/chart.svg, docs/chart.md
#   make picture        the README's picture: docs/before-after.png
#   make check-san      C tests under SAN=address,undefined (or memory, with CC=clang)
#   make help           this text
#
# Settings: CC, HOSTCC (compiler of build-time tools when cross compiling), CFLAGS and LDFLAGS (added
# last), OPT=-O3, WERROR=1, SAN=address,undefined (in a build folder of its own), BUILD=folder, and
# OPENEXR=0, PNG=0, THREADS=0, OPENCL=0 to leave an optional part out. The .mk files list the sources.

ifeq ($(origin CC),default)
CC := $(or $(shell for c in cc gcc clang; do command -v $$c >/dev/null && echo $$c && break; done),cc)
endif
HOSTCC ?= $(if $(shell command -v cc),cc,$(CC))
AR ?= ar
WERROR ?= 0
SAN ?=
OPT ?= $(if $(SAN),-O1,-O3)
THREADS ?= 1
PYTHON ?= python3

comma := ,
empty :=
space := $(empty) $(empty)
ifneq ($(SAN),)
BUILD ?= build/san-$(subst $(comma),-,$(SAN))
endif
BUILD ?= build
ifneq ($(words $(BUILD)),1)
$(error BUILD='$(BUILD)': it must name a folder, without blanks)
endif

include lib/sources.mk ports/sources.mk oidn/sources.mk apps/sources.mk
TESTS :=
include $(sort $(wildcard tests/*/sources.mk))
ifneq ($(SAN),)
TESTS := $(filter-out $(TESTS_NOT_SANITIZED),$(TESTS))
endif

# ---- What the compiler makes code for ------------------------------------------------------------

MACHINE := $(shell $(CC) $(CFLAGS) -dumpmachine 2>/dev/null)
ifeq ($(MACHINE),)
$(error '$(CC)' is not a working C compiler: install one (Debian: apt-get install gcc) or set CC)
endif
CPU := $(firstword $(subst -, ,$(MACHINE)))
ARCH := other
ifneq ($(filter x86_64 amd64 i386 i486 i586 i686,$(CPU)),)
ARCH := x86
else ifneq ($(filter aarch64 arm64,$(CPU)),)
ARCH := arm64
else ifneq ($(filter arm armv7%,$(CPU)),)
ARCH := arm32
else ifneq ($(filter wasm32,$(CPU)),)
ARCH := wasm32
endif
SYSTEM := elf
ifneq ($(findstring darwin,$(MACHINE)),)
SYSTEM := darwin
else ifneq ($(findstring mingw,$(MACHINE)),)
SYSTEM := windows
else ifeq ($(ARCH),wasm32)
SYSTEM := wasm
THREADS := 0
OPENCL := 0
ifeq ($(origin AR),default)
AR := $(shell $(CC) -print-prog-name=llvm-ar)
endif
endif

# 1 if the compiler takes these flags; warnings do not count where it warns of CFLAGS alone.
probe = $(shell echo 'int lull_probe;' | $(CC) $(CFLAGS) $(1) -x c -E - >/dev/null 2>&1 && echo 1)
PROBE_WERROR := $(if $(call probe,-Werror),-Werror)
takes = $(call probe,$(1) $(PROBE_WERROR))

port_flags = $(PORT_$(1)_FLAGS) $(PORT_$(1)_FLAGS_$(ARCH))
port_built = $(if $(strip $(PORT_$(1)_SOURCES)),$(if $(filter any $(ARCH),$(PORT_$(1)_ARCH)),$(if \
             $(strip $(port_flags)),$(call takes,$(port_flags)),1)))
PORTS := $(foreach g,$(PORT_GROUPS),$(if $(call port_built,$(g)),$(g)))
PORT_SOURCES := $(foreach g,$(PORTS),$(PORT_$(g)_SOURCES))

# ---- Optional parts ------------------------------------------------------------------------------

# This machine's pkg-config knows nothing of another machine's libraries: when cross compiling, they are
# used only if PKG_CONFIG names one that does.
HOST_MACHINE := $(shell $(HOSTCC) -dumpmachine 2>/dev/null)
HOST_CPU := $(firstword $(subst -, ,$(HOST_MACHINE)))
mingw = $(findstring mingw,$(1))
ifeq ($(CPU)$(call mingw,$(MACHINE))$(filter -m32,$(CC) $(CFLAGS)),$(HOST_CPU)$(call mingw,$(HOST_MACHINE)))
PKG_CONFIG ?= pkg-config
else
PKG_CONFIG ?= false
endif

# $(call part,setting,pkg-config module): 1 if wanted and found
part = $(if $(filter 0,$($(1))),0,$(if $(shell $(PKG_CONFIG) --exists '$(2)' 2>/dev/null && echo 1),1,0))
WITH_OPENEXR := $(call part,OPENEXR,OpenEXR >= 3.1)
WITH_PNG := $(call part,PNG,libpng)
WITH_THREADS := $(if $(filter 0,$(THREADS)),0,1)
WITH_OPENCL := $(if $(filter 0,$(OPENCL)),0,1)

ifeq ($(WITH_OPENEXR),1)
OPENEXR_CFLAGS := $(shell $(PKG_CONFIG) --cflags OpenEXR)
OPENEXR_LIBS := $(shell $(PKG_CONFIG) --libs-only-L OpenEXR) -lOpenEXRCore
endif
ifeq ($(WITH_PNG),1)
PNG_CFLAGS := $(shell $(PKG_CONFIG) --cflags libpng)
PNG_LIBS := $(shell $(PKG_CONFIG) --libs libpng)
endif

# The memory sanitizer knows only what it has compiled itself.
ifneq ($(findstring memory,$(SAN)),)
WITH_OPENEXR := 0
WITH_PNG := 0
WITH_OPENCL := 0
OPENEXR_CFLAGS :=
OPENEXR_LIBS :=
PNG_CFLAGS :=
PNG_LIBS :=
endif

# ---- Flags ---------------------------------------------------------------------------------------

WARNINGS := -Wall -Wextra -Wundef -Wshadow -Wvla -Wstrict-prototypes -Wmissing-prototypes
STRICT := $(if $(filter 0,$(WERROR)),,-Werror) # not one of the settings: objects are the same without it
ifneq ($(SAN),)
SAN_FLAGS := -fsanitize=$(SAN) -fno-sanitize-recover=all -fno-omit-frame-pointer -g
endif
# Equal results on every CPU: no fused multiply-add behind our back, and no x87 registers.
EXACT := -ffp-contract=off
ifneq ($(filter i386 i486 i586 i686,$(CPU))$(filter -m32,$(CC) $(CFLAGS)),)
ifeq ($(ARCH),x86)
EXACT += -msse2 -mfpmath=sse
endif
endif
# GCC for s390x evaluates floats in double under -std=c99.
ifeq ($(CPU),s390x)
EXACT += $(if $(call takes,-fexcess-precision=fast),-fexcess-precision=fast)
endif
ifeq ($(filter windows wasm,$(SYSTEM)),)
PIC := -fPIC
endif
# Compilers for WebAssembly take it that there is one thread, and may write to memory where the source
# does not, if with the value that is there. The core, compiled once, is in lull-threads.wasm, too.
ifeq ($(SYSTEM),wasm)
THREAD_MODEL := $(if $(call takes,-mthread-model posix),-mthread-model posix)
endif
DEFINES := -DLULL_WITH_OPENEXR=$(WITH_OPENEXR) -DLULL_WITH_PNG=$(WITH_PNG) \
           -DLULL_WITH_THREADS=$(WITH_THREADS) -DLULL_WITH_OPENCL=$(WITH_OPENCL) \
           $(foreach g,$(PORT_GROUPS),-DLULL_WITH_$(g)=$(if $(filter $(g),$(PORTS)),1,0))
BASE_FLAGS = -std=c99 $(OPT) $(EXACT) $(WARNINGS) -fvisibility=hidden $(PIC) $(THREAD_MODEL) $(SAN_FLAGS) $(DEFINES)
# lib/ and ports/ call nothing of libc but mem*: no stack protector, no _chk variants, no bcmp (clang).
CORE_FLAGS := -fno-stack-protector -U_FORTIFY_SOURCE -fno-builtin-bcmp $(if $(call takes,-fstack-usage),-fstack-usage)
# Kernels call nothing back, so that nothing is unwound through them: 30 kB of tables less.
KERNEL_FLAGS := $(if $(SAN),,$(if $(call takes,-fno-asynchronous-unwind-tables),-fno-asynchronous-unwind-tables))
HOSTED_FLAGS := -D_POSIX_C_SOURCE=200809L -D_FILE_OFFSET_BITS=64 -Ilib -Ioidn/include $(if $(filter 1,$(WITH_THREADS)),-pthread)
ifeq ($(SYSTEM),windows)
HOSTED_FLAGS += -D__USE_MINGW_ANSI_STDIO=1
STATIC_FLAGS := -DOIDN_STATIC_LIB # tools and tests hold the library
else ifeq ($(SYSTEM),wasm)
HOSTED_FLAGS += -D_WASI_EMULATED_PROCESS_CLOCKS
endif
# What the facade needs beside the C library; dlopen is in libdl where that is not empty.
THREAD_LIBS := $(if $(filter 1,$(WITH_THREADS)),-pthread)$(if $(filter 1elf,$(WITH_OPENCL)$(SYSTEM)), -ldl)$(if \
               $(filter wasm,$(SYSTEM)),-lwasi-emulated-process-clocks)

# ---- What is built -------------------------------------------------------------------------------

object = $(patsubst %.c,$(BUILD)/obj/%.o,$(1))
LIB_OBJECTS := $(call object,$(LIB_SOURCES) $(PORT_SOURCES))
OIDN_OBJECTS := $(call object,$(OIDN_SOURCES))
APP_SOURCES := $(sort $(APP_COMMON_SOURCES) $(foreach a,$(APPS),$(APP_$(a)_SOURCES)))
TEST_SOURCES := $(sort $(foreach t,$(TESTS),$(TEST_$(t)_SOURCES)))
ifeq ($(WITH_OPENCL),1)
OPENCL_OBJECTS := $(call object,$(OPENCL_SOURCES)) $(BUILD)/obj/opencl_source.o
endif
FACADE_OBJECTS := $(LIB_OBJECTS) $(OIDN_OBJECTS) $(OPENCL_OBJECTS) $(BUILD)/obj/weights.o

EXE := $(if $(filter windows,$(SYSTEM)),.exe)
IMPLIB :=
LIBLULL := $(BUILD)/lib/liblull.a
LIBOIDN := $(BUILD)/lib/libOpenImageDenoise.a
ifeq ($(SYSTEM),darwin)
SONAME := libOpenImageDenoise.2.dylib
SOLINK := libOpenImageDenoise.dylib
SOFLAGS := -dynamiclib -install_name @rpath/$(SONAME)
else ifeq ($(SYSTEM),windows)
SONAME := OpenImageDenoise.dll
IMPLIB := $(BUILD)/lib/libOpenImageDenoise.dll.a
SOFLAGS := -shared -static-libgcc -Wl,--out-implib,$(IMPLIB)
else
SONAME := libOpenImageDenoise.so.2
SOLINK := libOpenImageDenoise.so
# nodelete: dlclose leaves the code of a device's threads where it is, as hosts know it of the original.
SOFLAGS := -shared -Wl,-soname,$(SONAME) -Wl,--gc-sections -Wl,-z,nodelete $(if $(SAN),,-Wl,-z,defs)
endif
ifeq ($(SYSTEM),wasm)
PROGRAMS := $(addprefix $(BUILD)/bin/,lull.wasm lull-threads.wasm $(notdir $(wildcard apps/web/*.mjs)))
else
SHARED := $(BUILD)/lib/$(SONAME) $(if $(SOLINK),$(BUILD)/lib/$(SOLINK))
PROGRAMS := $(foreach a,$(APPS),$(BUILD)/bin/$(a)$(EXE))
endif
TEST_PROGRAMS := $(foreach t,$(TESTS),$(BUILD)/test/$(t)$(EXE))

.DEFAULT_GOAL := all
.PHONY: all programs tests clean help FORCE
.DELETE_ON_ERROR:
.SECONDARY:

all: $(LIBLULL) $(LIBOIDN) $(SHARED) $(PROGRAMS)
tests: all $(TEST_PROGRAMS) $(BUILD)/tests.txt

# ---- Settings: one file that all objects depend on, shown when it changes ------------------------

yesno = $(if $(filter 1,$(1)),yes,no   $(2))
define SETTINGS
lull for $(MACHINE)
  compiler   $(CC) $(BASE_FLAGS) $(CFLAGS) $(LDFLAGS)
  ports      $(PORTS)$(foreach g,$(filter-out $(PORTS),$(PORT_GROUPS)),$(if \
    $(strip $(PORT_$(g)_SOURCES)),$(if $(filter any $(ARCH),$(PORT_$(g)_ARCH)), (no $(g): the compiler lacks it))))
  OpenEXR    $(call yesno,$(WITH_OPENEXR),$(if $(filter 0,$(OPENEXR)),(OPENEXR=0),(pkg-config finds \
    no OpenEXR >= 3.1; Debian: libopenexr-dev pkg-config)))
  PNG        $(call yesno,$(WITH_PNG),$(if $(filter 0,$(PNG)),(PNG=0),(pkg-config finds no libpng; \
    Debian: libpng-dev pkg-config)))
  threads    $(call yesno,$(WITH_THREADS),(THREADS=0))
  OpenCL     $(call yesno,$(WITH_OPENCL),(OPENCL=0))
endef
export SETTINGS

$(BUILD)/settings.txt: FORCE
	@mkdir -p $(@D)
	@printf '%s\n' "$$SETTINGS" >$@.new; \
	if cmp -s $@.new $@; then rm -f $@.new; else mv -f $@.new $@; cat $@; fi

$(BUILD)/tests.txt: FORCE
	@mkdir -p $(@D)
	@printf '%s\n' $(TEST_PROGRAMS) >$@.new; cmp -s $@.new $@ && rm -f $@.new || mv -f $@.new $@

# ---- Compiling -----------------------------------------------------------------------------------

# A port's instruction set comes last: CFLAGS with another (-march=native, -mno-avx512f) are for the rest.
ISA :=
compile = $(CC) $(BASE_FLAGS) $(STRICT) $(FLAGS) $(CFLAGS) $(ISA) -MMD -MP -c -o $@ $<
ifeq ($(V),1)
say =
else
say = @printf '  %-8s %s\n' $(1) $(patsubst $(BUILD)/%,%,$(2)); 
endif

$(BUILD)/obj/lib/%.o: FLAGS = $(CORE_FLAGS)
$(BUILD)/obj/ports/%.o: FLAGS = $(CORE_FLAGS) $(KERNEL_FLAGS) -Ilib
$(BUILD)/obj/oidn/%.o: FLAGS = $(HOSTED_FLAGS) -DOpenImageDenoise_EXPORTS -Iweights -I$(BUILD)/gen
$(BUILD)/obj/apps/%.o: FLAGS = $(HOSTED_FLAGS) $(STATIC_FLAGS) -Iapps -Iweights $(OPENEXR_CFLAGS) $(PNG_CFLAGS)
$(BUILD)/obj/tests/%.o: FLAGS = $(HOSTED_FLAGS) $(STATIC_FLAGS) -Itests -Iapps -I. $(OPENEXR_CFLAGS) $(PNG_CFLAGS) $(TEST_FLAGS)

define port_rules
$(call object,$(PORT_$(1)_SOURCES)): ISA := $(call port_flags,$(1))
endef
$(foreach g,$(PORTS),$(eval $(call port_rules,$(g))))

$(BUILD)/obj/%.o: %.c $(BUILD)/settings.txt
	@mkdir -p $(@D)
	$(call say,CC,$<)$(compile)

# The module for JavaScript, without threads and with them.
$(BUILD)/obj/apps/web/%.o: FLAGS += -DLULL_WEB_THREADS=0
$(BUILD)/obj/threads/%.o: FLAGS = $(HOSTED_FLAGS) -DLULL_WEB_THREADS=1 -matomics -mbulk-memory -mmutable-globals
$(BUILD)/obj/threads/%.o: %.c $(BUILD)/settings.txt
	@mkdir -p $(@D)
	$(call say,CC,$<)$(compile)

# ---- Built-in weights ----------------------------------------------------------------------------

$(BUILD)/host/embed: weights/embed.c weights/builtin.def
	@mkdir -p $(@D)
	$(call say,HOSTCC,$<)$(HOSTCC) -std=c99 -O1 -Wall -Wextra -Iweights -o $@ $<

$(BUILD)/gen/weights.c: $(BUILD)/host/embed $(wildcard weights/*.tza)
	@mkdir -p $(@D)
	$(call say,EMBED,$@)$< weights $@

# ---- The program for OpenCL devices --------------------------------------------------------------

$(BUILD)/gen/opencl_source.c: $(BUILD)/host/embed $(OPENCL_TEXTS)
	@mkdir -p $(@D)
	$(call say,EMBED,$@)$< --text lull_opencl_source $@ $(OPENCL_TEXTS)

# Both are C files that need nothing but a compiler.
$(BUILD)/obj/%.o: $(BUILD)/gen/%.c $(BUILD)/settings.txt
	@mkdir -p $(@D)
	$(call say,CC,$<)$(compile)

# ---- Linking -------------------------------------------------------------------------------------

link = $(CC) $(OPT) $(SAN_FLAGS) $(CFLAGS) -o $@ $(1) $(LDFLAGS)

$(LIBLULL): $(LIB_OBJECTS)
$(LIBOIDN): $(FACADE_OBJECTS)
$(LIBLULL) $(LIBOIDN):
	@mkdir -p $(@D)
	@rm -f $@
	$(call say,AR,$@)$(AR) rcs $@ $^

$(BUILD)/lib/$(SONAME): $(FACADE_OBJECTS)
	@mkdir -p $(@D)
	$(call say,LINK,$@)$(call link,$(SOFLAGS) $^) $(THREAD_LIBS)

ifneq ($(SOLINK),)
$(BUILD)/lib/$(SOLINK): $(BUILD)/lib/$(SONAME)
	@ln -sf $(SONAME) $@
endif

APP_LIBS := $(OPENEXR_LIBS) $(PNG_LIBS) -lm $(THREAD_LIBS) $(if $(filter windows,$(SYSTEM)),-static)
define app_rules
$(BUILD)/bin/$(1)$(EXE): $(call object,$(sort $(APP_$(1)_SOURCES) $(APP_COMMON_SOURCES))) $(LIBOIDN)
	@mkdir -p $$(@D)
	$$(call say,LINK,$$@)$$(call link,$$^) $$(APP_LIBS)
endef
$(foreach a,$(APPS),$(eval $(call app_rules,$(a))))

# The core as a module for JavaScript: no C library but its memcpy and the like, nothing but progress
# is imported.
WEB_FLAGS := -nostartfiles -Wl,--no-entry,--gc-sections,-s
$(BUILD)/bin/lull.wasm: $(call object,$(APP_WEB_SOURCES)) $(LIBLULL)
	@mkdir -p $(@D)
	$(call say,LINK,$@)$(call link,$(WEB_FLAGS) $^)
# The same in a memory that it shares with its workers. lull.mjs knows its first size, and may give it
# less than the limit.
SHARED_FLAGS := $(WEB_FLAGS),--import-memory,--shared-memory,--initial-memory=1048576,--max-memory=4294967296
WEB_THREADS_OBJECTS := $(patsubst %.c,$(BUILD)/obj/threads/%.o,$(APP_WEB_SOURCES) $(APP_WEB_THREADS_SOURCES))
$(BUILD)/bin/lull-threads.wasm: $(WEB_THREADS_OBJECTS) $(LIBLULL)
	@mkdir -p $(@D)
	$(call say,LINK,$@)$(call link,$(SHARED_FLAGS)$(comma)--export=__stack_pointer $^)
$(BUILD)/bin/%.mjs: apps/web/%.mjs
	@mkdir -p $(@D)
	@cp $< $@

# Test programs may use the app sources that they name in their lists.
define test_rules
$(call object,$(filter tests/%,$(TEST_$(1)_SOURCES))): TEST_FLAGS := $(TEST_$(1)_FLAGS)
$(BUILD)/test/$(1)$(EXE): $(call object,$(TEST_$(1)_SOURCES)) $(LIBOIDN)
	@mkdir -p $$(@D)
	$$(call say,LINK,$$@)$$(call link,$$^) $$(APP_LIBS) $(TEST_$(1)_LIBS)
endef
$(foreach t,$(TESTS),$(eval $(call test_rules,$(t))))

# ---- One file ------------------------------------------------------------------------------------

.PHONY: amalgamation
amalgamation: $(BUILD)/gen/weights.c
	@$(PYTHON) -m lib.amalgamate $(BUILD)/amalgamation $<
	@echo '$(BUILD)/amalgamation: lull.c lull.h, with the built-in models lull_weights.c lull_weights.h'

# ---- Demo and tests ------------------------------------------------------------------------------

VENV := build/venv
.PHONY: demo train-demo check check-built check-san conform peer peer-test bench-peer chart peer-ready

# Where the tools of the tests and comparisons find the build.
TOOLS := LULL_BUILD='$(abspath $(BUILD))' PYTHON='$(abspath $(VENV))/bin/python'

# As many jobs as CPUs, unless make was given a number.
JOBS = $(if $(filter -j% --jobserver%,$(MAKEFLAGS)),,-j$(or $(shell nproc 2>/dev/null),2))

# The tests' own settings may change what pkg-config finds, so make reads itself again after them.
demo:
	@sh tests/setup.sh build
	@$(MAKE) $(JOBS) --no-print-directory all
	@sh demo/run.sh $(BUILD)

check:
	@sh tests/setup.sh check $(VENV)
	@$(MAKE) $(JOBS) --no-print-directory check-built

check-built: tests
	@$(VENV)/bin/python tests/run.py --build $(BUILD) $(CHECK)

# From nothing to weights: scenes, a training of ten minutes, an integer model, a check of its gain.
train-demo:
	@sh tests/setup.sh check $(VENV)
	@$(MAKE) $(JOBS) --no-print-directory all
	@sh demo/train.sh $(BUILD) $(VENV)/bin/python

# C tests and scripts under sanitizers; SAN=memory with CC=clang
ifeq ($(SAN),)
check-san:
	@$(MAKE) --no-print-directory check-san SAN=address,undefined
else
check-san: tests
	@o=allocator_may_return_null=1; ASAN_OPTIONS=$$o MSAN_OPTIONS=$$o TSAN_OPTIONS=$$o \
	    LSAN_OPTIONS=suppressions=$(CURDIR)/tests/leaks.supp:print_suppressions=0 \
	    $(PYTHON) tests/run.py --build $(BUILD) --kinds program $(CHECK)
endif

# Every port against scalar, slot by slot, and each one's speed; docs/ports.md keeps the results.
conform: $(BUILD)/test/conform$(EXE) $(BUILD)/test/conform_emulated$(EXE)
	@$(BUILD)/test/conform$(EXE)
	@$(BUILD)/test/conform_emulated$(EXE)
	@$(PYTHON) tests/conform/record.py --build $(BUILD) $(CONFORM)

# The same for WebAssembly: in build/wasm/bin lull.wasm, lull-threads.wasm and their interface for
# JavaScript, lull.mjs.
.PHONY: wasm
WASM_CC ?= clang --target=wasm32-wasi
wasm:
	@echo 'int main(void) { return 0; }' | $(WASM_CC) -x c - -o /dev/null 2>/dev/null || { echo "make wasm: \
	'$(WASM_CC)' makes no programs: install clang, wasm-ld and the C library of WASI (Debian: clang lld \
	wasi-libc libclang-rt-dev-wasm32), or set WASM_CC" >&2; exit 2; }
	@$(MAKE) --no-print-directory all CC='$(WASM_CC)' BUILD='$(BUILD)/wasm'

# ---- Beside the real Open Image Denoise (Python package pyoidn) ----------------------------------

peer-ready:
	@sh tests/setup.sh peer $(VENV)
	@$(MAKE) $(JOBS) --no-print-directory all

# Equal weights, equal pictures: the outputs differ by less than OIDN's own tests allow.
peer: peer-ready
	@$(TOOLS) $(VENV)/bin/python -m bench.peer $(PEER)

# OIDN's own test program and clients on our library.
peer-test: peer-ready
	@$(TOOLS) sh tests/api/peer_test.sh
	@$(TOOLS) sh tests/api/peer_test.sh --sanitize

# Speed and memory, in one run.
bench-peer: peer-ready
	@$(TOOLS) $(VENV)/bin/python -m bench.speed $(BENCH)

# Speed against accuracy: docs/chart.svg and docs/chart.md.
chart: peer-ready
	@$(TOOLS) $(VENV)/bin/python -m bench.chart $(CHART)

# The README's picture.
.PHONY: picture
picture: peer-ready
	@$(TOOLS) $(VENV)/bin/python -m bench.before_after

# ---- Installing ----------------------------------------------------------------------------------

prefix ?= /usr/local
bindir ?= $(prefix)/bin
libdir ?= $(prefix)/lib
includedir ?= $(prefix)/include
mandir ?= $(prefix)/share/man
DESTDIR ?=
INSTALL ?= install

version_of = $(subst $(space),.,$(shell sed -n 's/^\#define $(1)_VERSION_[A-Z]* \([0-9][0-9]*\).*/\1/p' $(2)))
OIDN_VERSION = $(call version_of,OIDN,oidn/include/OpenImageDenoise/config.h)
LULL_VERSION = $(call version_of,LULL,lib/lull.h)
cmakedir = $(libdir)/cmake/OpenImageDenoise-$(OIDN_VERSION)
# Of folders below the prefix, .pc files name only what is below it: a tree may be moved.
FILL = sed -e 's|@PREFIX@|$(prefix)|g' -e 's|@INCLUDEDIR@|$(includedir)|g' \
       -e 's|@PC_LIBDIR@|$(libdir)|g' -e 's|@PC_INCLUDEDIR@|$(includedir)|g' \
       -e 's|^\([a-z]*dir\)=$(prefix)/|\1=$${prefix}/|' \
       -e 's|@OIDN_VERSION@|$(OIDN_VERSION)|g' -e 's|@LULL_VERSION@|$(LULL_VERSION)|g' \
       -e 's|@SONAME@|$(SONAME)|g' -e 's|@THREAD_LIBS@|$(THREAD_LIBS)|g'
# CMake's package is of the shared library.
TEMPLATES := $(wildcard oidn/packaging/*.pc.in $(if $(SHARED),oidn/packaging/*.cmake.in))
MAN_PAGES := $(wildcard apps/man/*.1)

.PHONY: install uninstall
install: all
	$(INSTALL) -d '$(DESTDIR)$(bindir)' '$(DESTDIR)$(libdir)/pkgconfig' \
	    '$(DESTDIR)$(includedir)/OpenImageDenoise' '$(DESTDIR)$(cmakedir)' '$(DESTDIR)$(mandir)/man1'
	$(INSTALL) -m 644 lib/lull.h '$(DESTDIR)$(includedir)'
	$(INSTALL) -m 644 oidn/include/OpenImageDenoise/* '$(DESTDIR)$(includedir)/OpenImageDenoise'
	$(INSTALL) -m 644 $(LIBLULL) $(LIBOIDN) $(IMPLIB) '$(DESTDIR)$(libdir)'
	$(if $(SHARED),$(INSTALL) -m 755 $(BUILD)/lib/$(SONAME) '$(DESTDIR)$(libdir)')
	$(if $(filter %/$(SOLINK),$(SHARED)),ln -sf $(SONAME) '$(DESTDIR)$(libdir)/$(SOLINK)')
	$(if $(PROGRAMS),$(INSTALL) -m 755 $(PROGRAMS) '$(DESTDIR)$(bindir)')
	set -e; for t in $(TEMPLATES); do \
	    name=$$(basename $$t .in); \
	    case $$name in *.pc) to='$(libdir)/pkgconfig' ;; *) to='$(cmakedir)' ;; esac; \
	    $(FILL) $$t >'$(DESTDIR)'"$$to/$$name"; chmod 644 '$(DESTDIR)'"$$to/$$name"; done
	$(if $(MAN_PAGES),$(INSTALL) -m 644 $(MAN_PAGES) '$(DESTDIR)$(mandir)/man1')

# What install has put there, and the folders that are its own.
taken = $(foreach f,$(2),'$(DESTDIR)$(1)/$(notdir $(f))')
uninstall:
	rm -f $(call taken,$(bindir),$(PROGRAMS)) $(call taken,$(includedir),lull.h) \
	    $(call taken,$(includedir)/OpenImageDenoise,$(wildcard oidn/include/OpenImageDenoise/*)) \
	    $(call taken,$(libdir),$(LIBLULL) $(LIBOIDN) $(IMPLIB) $(SONAME) $(SOLINK)) \
	    $(call taken,$(libdir)/pkgconfig,$(patsubst %.in,%,$(filter %.pc.in,$(TEMPLATES)))) \
	    $(call taken,$(cmakedir),$(patsubst %.in,%,$(filter %.cmake.in,$(TEMPLATES)))) \
	    $(call taken,$(mandir)/man1,$(MAN_PAGES))
	for d in '$(DESTDIR)$(cmakedir)' '$(DESTDIR)$(includedir)/OpenImageDenoise'; do \
	    [ ! -d "$$d" ] || rmdir "$$d" || exit 1; done

clean:
	rm -rf $(BUILD)

help:
	@sed -n '2,/^$$/s/^# \{0,1\}//p' Makefile

-include $(patsubst %.o,%.d,$(FACADE_OBJECTS) $(call object,$(APP_SOURCES) $(APP_WEB_SOURCES) $(TEST_SOURCES)) \
          $(WEB_THREADS_OBJECTS))
