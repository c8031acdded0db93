use std::fmt;
use std::os::raw::c_int;

/// Why an image was not denoised. Texts are the library's, in English, for people.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// A slice does not have `width * height * 3` values.
    Length {
        /// "color", "albedo" or "normal".
        image: &'static str,
        /// How many values it has.
        found: usize,
        /// How many it should have.
        wanted: usize,
    },
    /// So many pixels cannot be counted.
    Size {
        /// Pixels of a row.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// An option cannot be, or not with another one; or the image is larger than the library can.
    InvalidArgument(String),
    /// The weights are no model, or one of other images.
    InvalidOperation(String),
    /// The memory is not to be had, or more than [`Options::max_memory_mb`] allows.
    ///
    /// [`Options::max_memory_mb`]: crate::Options::max_memory_mb
    OutOfMemory(String),
    /// The library cannot use this processor.
    UnsupportedHardware(String),
    /// Everything else.
    Unknown(String),
}

impl Error {
    /// Of an error's number in the library.
    pub(crate) fn of_code(code: c_int, text: String) -> Error {
        match code {
            2 => Error::InvalidArgument(text),
            3 => Error::InvalidOperation(text),
            4 => Error::OutOfMemory(text),
            5 => Error::UnsupportedHardware(text),
            _ => Error::Unknown(text),
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Length { image, found, wanted } => {
                write!(f, "{}: {} values, where {} are wanted", image, found, wanted)
            }
            Error::Size { width, height } => {
                write!(f, "{}x{} pixels are too many", width, height)
            }
            Error::InvalidArgument(text)
            | Error::InvalidOperation(text)
            | Error::OutOfMemory(text)
            | Error::UnsupportedHardware(text)
            | Error::Unknown(text) => f.write_str(text),
        }
    }
}

impl std::error::Error for Error {}
