use crate::Error;
use std::fmt;
use std::os::raw::c_int;

/// Accuracy against speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Quality {
    /// The smallest model.
    Fast,
    /// The one between.
    Balanced,
    /// The largest model.
    #[default]
    High,
    /// The smallest model that the frame needs: a sample of the frame, denoised by all of them,
    /// tells. [`Denoiser::used_quality`](crate::Denoiser::used_quality) says which it was.
    Auto,
}

impl Quality {
    const NUMBERS: [(Quality, c_int); 4] =
        [(Quality::Fast, 4), (Quality::Balanced, 5), (Quality::High, 6), (Quality::Auto, 100)];

    pub(crate) fn number(self) -> c_int {
        Quality::NUMBERS.iter().find(|row| row.0 == self).map_or(0, |row| row.1)
    }

    pub(crate) fn of_number(number: c_int) -> Option<Quality> {
        Quality::NUMBERS.iter().find(|row| row.1 == number).map(|row| row.0)
    }
}

/// How a [`Denoiser`](crate::Denoiser) works: `Options::new().hdr(true).threads(2)`.
#[derive(Clone, PartialEq)]
pub struct Options {
    pub(crate) hdr: bool,
    pub(crate) srgb: bool,
    pub(crate) clean_aux: bool,
    pub(crate) panorama: bool,
    pub(crate) quality: Quality,
    pub(crate) ensemble: u32,
    pub(crate) threads: u32,
    pub(crate) input_scale: Option<f32>,
    pub(crate) max_memory_mb: Option<u32>,
    pub(crate) weights: Option<Vec<u8>>,
}

impl Options {
    /// A linear colour in \[0, 1\], noisy albedo and normals, [`Quality::High`], a thread per core.
    pub fn new() -> Options {
        Options {
            hdr: false,
            srgb: false,
            clean_aux: false,
            panorama: false,
            quality: Quality::High,
            ensemble: 1,
            threads: 0,
            input_scale: None,
            max_memory_mb: None,
            weights: None,
        }
    }

    /// Whether the colour is linear and unbounded; else it is in \[0, 1\]. Default: no.
    #[must_use]
    pub fn hdr(mut self, hdr: bool) -> Options {
        self.hdr = hdr;
        self
    }

    /// Whether the colour, which is not `hdr`, is sRGB-encoded; else it is linear. Default: no.
    #[must_use]
    pub fn srgb(mut self, srgb: bool) -> Options {
        self.srgb = srgb;
        self
    }

    /// Whether albedo and normals have no noise. Default: no.
    #[must_use]
    pub fn clean_aux(mut self, clean_aux: bool) -> Options {
        self.clean_aux = clean_aux;
        self
    }

    /// Whether the images are equirectangular panoramas of a whole sphere, whose edges meet: no seam
    /// is left there. Default: no.
    #[must_use]
    pub fn panorama(mut self, panorama: bool) -> Options {
        self.panorama = panorama;
        self
    }

    /// Which of the built-in models. Default: [`Quality::High`].
    #[must_use]
    pub fn quality(mut self, quality: Quality) -> Options {
        self.quality = quality;
        self
    }

    /// 1, 2 or 4: the mean of so many orientations of the frame, for as many times the time.
    /// Default: 1.
    #[must_use]
    pub fn ensemble(mut self, orientations: u32) -> Options {
        self.ensemble = orientations;
        self
    }

    /// How many threads work, the caller's among them. Default: 0, one per physical core. The
    /// environment variable `OIDN_NUM_THREADS` overrides it.
    #[must_use]
    pub fn threads(mut self, threads: u32) -> Options {
        self.threads = threads;
        self
    }

    /// Factor on the colour that brings it to about 1 where it matters. Default: `None`, measured
    /// in each frame if `hdr`, else 1.
    #[must_use]
    pub fn input_scale(mut self, scale: Option<f32>) -> Options {
        self.input_scale = scale;
        self
    }

    /// The most that a denoiser takes, in megabytes, images not counted: with less than it would
    /// like it takes longer, to the same bytes. Default: `None`, no limit.
    #[must_use]
    pub fn max_memory_mb(mut self, limit: Option<u32>) -> Options {
        self.max_memory_mb = limit;
        self
    }

    /// The bytes of a weights file (TZA), of this project's training or Open Image Denoise's, in
    /// the place of the built-in models. They are looked at when the first frame is denoised, and
    /// must be of the images that it has. Default: none.
    #[must_use]
    pub fn weights(mut self, tza: impl Into<Vec<u8>>) -> Options {
        self.weights = Some(tza.into());
        self
    }

    /// An error for what no library call would find, or not before the first frame.
    pub(crate) fn check(&self) -> Result<(), Error> {
        let fail = |text: String| Err(Error::InvalidArgument(text));
        if self.hdr && self.srgb {
            return fail("srgb: hdr colours are linear".into());
        }
        if ![1, 2, 4].contains(&self.ensemble) {
            return fail(format!("ensemble: {} is none of 1, 2, 4", self.ensemble));
        }
        for (name, value) in
            [("threads", self.threads), ("max_memory_mb", self.max_memory_mb.unwrap_or(0))]
        {
            if c_int::try_from(value).is_err() {
                return fail(format!("{}: {} is too large", name, value));
            }
        }
        Ok(())
    }
}

impl Default for Options {
    fn default() -> Options {
        Options::new()
    }
}

impl fmt::Debug for Options {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Options")
            .field("hdr", &self.hdr)
            .field("srgb", &self.srgb)
            .field("clean_aux", &self.clean_aux)
            .field("panorama", &self.panorama)
            .field("quality", &self.quality)
            .field("ensemble", &self.ensemble)
            .field("threads", &self.threads)
            .field("input_scale", &self.input_scale)
            .field("max_memory_mb", &self.max_memory_mb)
            .field("weights_bytes", &self.weights.as_ref().map(Vec::len))
            .finish()
    }
}
