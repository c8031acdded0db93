//! Removes the noise of path-traced images, on any CPU. The library and its models are in the
//! program: nothing is loaded when it runs.
//!
//! ```
//! use lull::{Denoiser, Options, Quality};
//!
//! # fn main() -> Result<(), lull::Error> {
//! let (width, height) = (64, 48);
//! let color = vec![0.5_f32; width * height * 3]; // what the renderer gave
//! let albedo = vec![0.8_f32; width * height * 3];
//! let normal = [0.0_f32, 0.0, 1.0].repeat(width * height);
//!
//! let options = Options::new().hdr(true).quality(Quality::Balanced);
//! let mut denoiser = Denoiser::new(options)?; // keeps threads and memory from frame to frame
//! let clean = denoiser.denoise(&color, Some(&albedo), Some(&normal), width, height)?;
//! assert_eq!(clean.len(), color.len());
//! # Ok(())
//! # }
//! ```
//!
//! # Images
//!
//! An image is a slice of `width * height * 3` values: rows from the top to the bottom, pixels from
//! left to right, three values a pixel without gaps. The library reads them where they lie.
//! Of pixels `&[[f32; 3]]`, `as_flattened()` makes such a slice.
//!
//! * Colour: with [`Options::hdr`] linear and unbounded, 0 or more; else in \[0, 1\].
//! * Albedo: in \[0, 1\], of what the pixel sees. Optional, and of much use.
//! * Normals: in \[-1, 1\], in world or view space. Optional.
//!
//! NaN is taken for 0, what is out of these ranges for the nearest value in them.
//!
//! The same pixels and options give the same bytes, for any number of threads and on every
//! processor: with the built-in models and other integer ones.
#![warn(missing_docs)]
#![deny(unsafe_op_in_unsafe_fn)]

mod error;
mod ffi;
mod options;

pub use error::Error;
pub use options::{Options, Quality};

/// The examples of the README, as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

use std::ffi::CStr;
use std::os::raw::{c_char, c_int};
use std::ptr;

/// A literal as the library wants its names.
macro_rules! c {
    ($text:literal) => {
        concat!($text, "\0").as_ptr().cast::<c_char>()
    };
}

/// A filter with its options, threads and memory, to be called for one frame after another.
///
/// It may be moved to other threads. Frames are denoised one at a time (`&mut self`), on threads of
/// its own and the caller's; several denoisers may work at once. Dropping it ends its threads.
#[derive(Debug)]
pub struct Denoiser {
    device: ffi::Handle,
    filter: ffi::Handle,
    options: Options,
}

// The library's functions may be called by any thread; calls on one device wait for each other.
unsafe impl Send for Denoiser {}
unsafe impl Sync for Denoiser {}

/// The images of a frame; of one that is not given the library makes no use.
#[derive(Clone, Copy, Default)]
struct Inputs<'a> {
    color: Option<&'a [f32]>,
    albedo: Option<&'a [f32]>,
    normal: Option<&'a [f32]>,
}

impl Denoiser {
    /// Starts a denoiser's threads.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidArgument`] for options that cannot be, [`Error::UnsupportedHardware`] where
    /// the environment variable `OIDN_DEVICE_CPU=0` hides the processor, [`Error::OutOfMemory`].
    pub fn new(options: Options) -> Result<Denoiser, Error> {
        options.check()?;
        let mut made = Denoiser { device: ptr::null_mut(), filter: ptr::null_mut(), options };
        let options = &made.options;
        // SAFETY: the handles are those that the library gave, checked before their use. Weights
        // are read by the filter's commits, at which `made` still owns them.
        unsafe {
            made.device = ffi::new_device(ffi::DEVICE_CPU);
            made.check()?;
            if options.threads > 0 {
                ffi::set_device_int(made.device, c!("numThreads"), options.threads as c_int);
            }
            ffi::commit_device(made.device);
            made.check()?;
            made.filter = ffi::new_filter(made.device, c!("RT"));
            made.check()?;
            let filter = made.filter;
            ffi::set_bool(filter, c!("cleanAux"), options.clean_aux);
            ffi::set_bool(filter, c!("panorama"), options.panorama);
            ffi::set_int(filter, c!("quality"), options.quality.number());
            ffi::set_int(filter, c!("ensemble"), options.ensemble as c_int);
            if let Some(limit) = options.max_memory_mb {
                ffi::set_int(filter, c!("maxMemoryMB"), limit as c_int);
            }
            if let Some(weights) = &options.weights {
                let data = weights.as_ptr() as *mut _; // only read
                ffi::set_data(filter, c!("weights"), data, weights.len());
            }
        }
        made.check()?;
        Ok(made)
    }

    /// The denoised image, as many values as `color` has.
    ///
    /// # Errors
    ///
    /// [`Error::Length`] and [`Error::Size`] for slices that do not hold the image,
    /// [`Error::InvalidOperation`] for weights that are no model or take other images,
    /// [`Error::OutOfMemory`].
    pub fn denoise(
        &mut self,
        color: &[f32],
        albedo: Option<&[f32]>,
        normal: Option<&[f32]>,
        width: usize,
        height: usize,
    ) -> Result<Vec<f32>, Error> {
        self.denoise_new(Inputs { color: Some(color), albedo, normal }, width, height)
    }

    /// Puts the denoised image, the same as [`denoise`] gives, in the place of `color`, which all
    /// errors but [`Error::Unknown`] leave as it was.
    ///
    /// # Errors
    ///
    /// Those of [`denoise`].
    ///
    /// [`denoise`]: Denoiser::denoise
    pub fn denoise_in_place(
        &mut self,
        color: &mut [f32],
        albedo: Option<&[f32]>,
        normal: Option<&[f32]>,
        width: usize,
        height: usize,
    ) -> Result<(), Error> {
        let inputs = Inputs { color: None, albedo, normal };
        inputs.check(width, height)?;
        check_length("color", color, width, height)?;
        let pixels = color.as_mut_ptr();
        // SAFETY: `color` has the image's length, and nobody else has it.
        unsafe { self.run(inputs, Some(pixels), pixels, width, height) }
    }

    /// A denoised albedo, in \[0, 1\]: for images that are to be denoised with it and with
    /// [`Options::clean_aux`]. Of the options `hdr`, `srgb`, `clean_aux` and `input_scale` do not
    /// count.
    ///
    /// # Errors
    ///
    /// Those of [`denoise`](Denoiser::denoise).
    pub fn denoise_albedo(
        &mut self,
        albedo: &[f32],
        width: usize,
        height: usize,
    ) -> Result<Vec<f32>, Error> {
        let inputs = Inputs { albedo: Some(albedo), ..Inputs::default() };
        self.denoise_new(inputs, width, height)
    }

    /// Denoised normals, in \[-1, 1\], as [`denoise_albedo`](Denoiser::denoise_albedo) does it.
    ///
    /// # Errors
    ///
    /// Those of [`denoise`](Denoiser::denoise).
    pub fn denoise_normal(
        &mut self,
        normal: &[f32],
        width: usize,
        height: usize,
    ) -> Result<Vec<f32>, Error> {
        let inputs = Inputs { normal: Some(normal), ..Inputs::default() };
        self.denoise_new(inputs, width, height)
    }

    /// Which quality the last frame was denoised with: of interest with [`Quality::Auto`]. `None`
    /// before the first.
    pub fn used_quality(&self) -> Option<Quality> {
        // SAFETY: the filter lives, and any thread may ask.
        Quality::of_number(unsafe { ffi::get_int(self.filter, c!("usedQuality")) })
    }

    /// The options that it was made with.
    pub fn options(&self) -> &Options {
        &self.options
    }

    fn denoise_new(
        &mut self,
        inputs: Inputs<'_>,
        width: usize,
        height: usize,
    ) -> Result<Vec<f32>, Error> {
        let values = inputs.check(width, height)?;
        let mut output = vec![0.0; values];
        let color = inputs.color.map(to_read);
        // SAFETY: all have the image's length, and the output is new.
        unsafe { self.run(inputs, color, output.as_mut_ptr(), width, height)? };
        Ok(output)
    }

    /// Denoises into `output`.
    ///
    /// # Safety
    ///
    /// `color`, `inputs` and `output` hold images of this size; `output` is `color` or overlaps
    /// none of them, and nobody else uses it.
    unsafe fn run(
        &mut self,
        inputs: Inputs<'_>,
        color: Option<*mut f32>,
        output: *mut f32,
        width: usize,
        height: usize,
    ) -> Result<(), Error> {
        let images = [
            (c!("color"), color),
            (c!("albedo"), inputs.albedo.map(to_read)),
            (c!("normal"), inputs.normal.map(to_read)),
            (c!("output"), Some(output)),
        ];
        let has_color = color.is_some();
        let scale = self.options.input_scale.filter(|_| has_color).unwrap_or(f32::NAN);
        // SAFETY: the library reads inputs and writes the output in the commit and the execution
        // alone, which have ended when this function returns.
        unsafe {
            ffi::set_bool(self.filter, c!("hdr"), self.options.hdr && has_color);
            ffi::set_bool(self.filter, c!("srgb"), self.options.srgb && has_color);
            ffi::set_float(self.filter, c!("inputScale"), scale);
            for (name, image) in images {
                match image {
                    Some(data) => {
                        let (data, format) = (data.cast(), ffi::FORMAT_FLOAT3);
                        ffi::set_image(self.filter, name, data, format, width, height, 0, 0, 0);
                    }
                    None => ffi::unset_image(self.filter, name),
                }
            }
            self.check()?;
            ffi::commit_filter(self.filter);
            self.check()?;
            ffi::execute_filter(self.filter);
        }
        self.check()
    }

    /// What the library says of this thread's calls since the last check.
    fn check(&self) -> Result<(), Error> {
        let mut text: *const c_char = ptr::null();
        // SAFETY: without a device (null) the error is that of its creation; the text is valid
        // until this thread's next error.
        unsafe {
            let code = ffi::get_device_error(self.device, &mut text);
            if code == 0 {
                return Ok(());
            }
            let text = if text.is_null() {
                "unknown error".into()
            } else {
                CStr::from_ptr(text).to_string_lossy()
            };
            Err(Error::of_code(code, text.into_owned()))
        }
    }
}

impl Drop for Denoiser {
    fn drop(&mut self) {
        // SAFETY: both are released once, and nothing of them is used after that.
        unsafe {
            if !self.filter.is_null() {
                ffi::release_filter(self.filter);
            }
            if !self.device.is_null() {
                ffi::release_device(self.device);
            }
        }
    }
}

/// An image as the library takes inputs, which it does not write.
fn to_read(image: &[f32]) -> *mut f32 {
    image.as_ptr() as *mut f32
}

impl Inputs<'_> {
    /// The number of values that every image of this size has; an error if one of these has others.
    fn check(&self, width: usize, height: usize) -> Result<usize, Error> {
        let images = [("color", self.color), ("albedo", self.albedo), ("normal", self.normal)];
        for (name, image) in images {
            if let Some(values) = image {
                check_length(name, values, width, height)?;
            }
        }
        number_of_values(width, height)
    }
}

fn number_of_values(width: usize, height: usize) -> Result<usize, Error> {
    let values = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(3));
    values.ok_or(Error::Size { width, height })
}

fn check_length(
    image: &'static str,
    values: &[f32],
    width: usize,
    height: usize,
) -> Result<(), Error> {
    let wanted = number_of_values(width, height)?;
    match values.len() {
        found if found != wanted => Err(Error::Length { image, found, wanted }),
        _ => Ok(()),
    }
}
