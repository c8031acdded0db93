//! Those functions of the library that the crate calls: `oidn/include/OpenImageDenoise/oidn.h` of
//! the tree says what they do. `build.rs` gives their names the prefix.

use std::os::raw::{c_char, c_float, c_int, c_void};

/// A device or a filter.
pub type Handle = *mut c_void;

pub const DEVICE_CPU: c_int = 1;
pub const FORMAT_FLOAT3: c_int = 3;

macro_rules! functions {
    ($($name:ident = $symbol:literal ($($argument:ty),*) $(-> $result:ty)?;)*) => {
        extern "C" {
            $(#[link_name = concat!("lull_rs_", $symbol)]
            pub fn $name($(_: $argument),*) $(-> $result)?;)*
        }
    };
}

functions! {
    new_device = "oidnNewDevice" (c_int) -> Handle;
    set_device_int = "oidnSetDeviceInt" (Handle, *const c_char, c_int);
    commit_device = "oidnCommitDevice" (Handle);
    release_device = "oidnReleaseDevice" (Handle);
    get_device_error = "oidnGetDeviceError" (Handle, *mut *const c_char) -> c_int;
    new_filter = "oidnNewFilter" (Handle, *const c_char) -> Handle;
    release_filter = "oidnReleaseFilter" (Handle);
    set_image = "oidnSetSharedFilterImage"
        (Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
    unset_image = "oidnUnsetFilterImage" (Handle, *const c_char);
    set_data = "oidnSetSharedFilterData" (Handle, *const c_char, *mut c_void, usize);
    set_bool = "oidnSetFilterBool" (Handle, *const c_char, bool);
    set_int = "oidnSetFilterInt" (Handle, *const c_char, c_int);
    set_float = "oidnSetFilterFloat" (Handle, *const c_char, c_float);
    get_int = "oidnGetFilterInt" (Handle, *const c_char) -> c_int;
    commit_filter = "oidnCommitFilter" (Handle);
    execute_filter = "oidnExecuteFilter" (Handle);
}
