# Kernels, one group for each instruction set. Makefile, meson.build, CMakeLists.txt read this: plain
# assignments only, paths from the top of the tree.
#
#   PORT_<GROUP>_SOURCES      its files; a group without files is left out of the build
#   PORT_<GROUP>_ARCH         x86, arm64, arm32, wasm32 (several: separated by spaces) or any
#   PORT_<GROUP>_FLAGS        compiler flags for its objects and for nothing else
#   PORT_<GROUP>_FLAGS_<arch> the same, for one architecture only
#
# The macro LULL_WITH_<GROUP> is 1 where the group is built and 0 elsewhere.
PORT_GROUPS := SCALAR SSE41 AVX2 AVX512 AVXVNNI VNNI AMX NEON DOTPROD I8MM SIMD128

PORT_SCALAR_ARCH := any
# On x86 only CPUs before SSE4.1 run it: a third of the code of -O3.
PORT_SCALAR_FLAGS_x86 := -O2
PORT_SCALAR_SOURCES := ports/scalar/port_scalar.c ports/scalar/conv_f32_scalar.c \
                       ports/scalar/conv_int_scalar.c ports/scalar/pool_scalar.c ports/scalar/filter5_scalar.c \
                       ports/scalar/filter_scalar.c ports/scalar/regression_scalar.c ports/scalar/winograd_scalar.c ports/scalar/patches_scalar.c \
                       ports/scalar/curves_scalar.c

PORT_SSE41_ARCH := x86
PORT_SSE41_FLAGS := -mssse3 -msse4.1
PORT_SSE41_SOURCES := ports/x86/port_sse41.c ports/x86/conv_f32_sse41.c ports/x86/conv_int_sse41.c \
                      ports/x86/pool_sse41.c ports/x86/filter_sse41.c

PORT_AVX2_ARCH := x86
PORT_AVX2_FLAGS := -mavx2 -mfma
PORT_AVX2_SOURCES := ports/x86/port_avx2.c ports/x86/conv_f32_avx2.c ports/x86/conv_int_avx2.c \
                     ports/x86/pool_avx2.c ports/x86/filter_avx2.c \
                     ports/x86/winograd_avx2.c ports/x86/patches_avx2.c ports/x86/conv_points_avx2.c ports/x86/head_avx2.c ports/x86/curves_avx2.c

PORT_AVX512_ARCH := x86
PORT_AVX512_FLAGS := -mavx512f -mavx512bw -mavx512vl -mavx512dq -mfma -mprefer-vector-width=512
PORT_AVX512_SOURCES := ports/x86/port_avx512.c ports/x86/conv_f32_avx512.c \
                       ports/x86/conv_int_avx512.c ports/x86/filter_avx512.c \
                       ports/x86/winograd_avx512.c ports/x86/patches_avx512.c ports/x86/conv_points_avx512.c ports/x86/curves_avx512.c

PORT_AVXVNNI_ARCH := x86
PORT_AVXVNNI_FLAGS := -mavx2 -mfma -mavxvnni
PORT_AVXVNNI_SOURCES := ports/x86/port_avxvnni.c ports/x86/conv_int_avxvnni.c ports/x86/conv_points_avxvnni.c

PORT_VNNI_ARCH := x86
PORT_VNNI_FLAGS := -mavx512f -mavx512bw -mavx512vl -mavx512dq -mavx512vnni -mfma -mprefer-vector-width=512
PORT_VNNI_SOURCES := ports/x86/port_vnni.c ports/x86/conv_int_vnni.c ports/x86/conv_points_vnni.c

PORT_AMX_ARCH := x86
PORT_AMX_FLAGS := -mavx512f -mavx512bw -mavx512vl -mavx512dq -mavx512vnni -mamx-tile -mamx-int8 -mfma -mprefer-vector-width=512
PORT_AMX_SOURCES := ports/x86/port_amx.c ports/x86/conv_int_amx.c

PORT_NEON_ARCH := arm64 arm32
PORT_NEON_FLAGS_arm32 := -mfpu=neon
PORT_NEON_SOURCES := ports/arm/port_neon.c ports/arm/conv_f32_neon.c ports/arm/conv_int_neon.c \
                     ports/arm/pool_neon.c ports/arm/filter_neon.c ports/arm/winograd_neon.c

PORT_DOTPROD_ARCH := arm64
PORT_DOTPROD_FLAGS := -march=armv8.2-a+dotprod
PORT_DOTPROD_SOURCES := ports/arm/port_dotprod.c ports/arm/conv_int_dotprod.c

PORT_I8MM_ARCH := arm64
PORT_I8MM_FLAGS := -march=armv8.2-a+dotprod+i8mm
PORT_I8MM_SOURCES := ports/arm/port_i8mm.c ports/arm/conv_int_i8mm.c

PORT_SIMD128_ARCH := wasm32
PORT_SIMD128_FLAGS := -msimd128
PORT_SIMD128_SOURCES := ports/wasm/port_simd128.c ports/wasm/conv_f32_simd128.c ports/wasm/conv_int_simd128.c \
                        ports/wasm/pool_simd128.c ports/wasm/filter_simd128.c
