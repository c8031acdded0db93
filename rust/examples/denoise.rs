//! Denoises a PFM image, HDR, with its albedo and normals where there are some:
//!
//!     cargo run --release --example denoise -- color.pfm clean.pfm [albedo.pfm [normal.pfm]]

use lull::{Denoiser, Options};
use std::error::Error;
use std::{env, fs};

struct Image {
    width: usize,
    height: usize,
    pixels: Vec<f32>, // rows from the top to the bottom
}

/// Reads "PF", width, height, and a number whose sign is the order of bytes; then rows of floats,
/// the lowest first.
fn read_pfm(path: &str) -> Result<Image, Box<dyn Error>> {
    let file = fs::read(path).map_err(|error| format!("{}: {}", path, error))?;
    let wrong = || format!("{}: not a PFM image of three channels", path);
    let (mut words, mut at) = (Vec::new(), 0);
    while words.len() < 4 {
        let length = file[at..].iter().position(u8::is_ascii_whitespace).ok_or_else(wrong)?;
        if length > 0 {
            words.push(std::str::from_utf8(&file[at..at + length])?);
        }
        at += length + 1;
    }
    let (width, height): (usize, usize) = (words[1].parse()?, words[2].parse()?);
    let is_little = words[3].parse::<f32>()? < 0.0;
    let row = width.checked_mul(12).ok_or_else(wrong)?;
    if words[0] != "PF" || Some(file.len() - at) != row.checked_mul(height) || row == 0 {
        return Err(wrong().into());
    }
    let from = if is_little { f32::from_le_bytes } else { f32::from_be_bytes };
    let rows = file[at..].chunks_exact(row).rev();
    let values = rows.flat_map(|row| row.chunks_exact(4));
    let pixels = values.map(|bytes| from([bytes[0], bytes[1], bytes[2], bytes[3]])).collect();
    Ok(Image { width, height, pixels })
}

fn write_pfm(path: &str, image: &Image) -> Result<(), Box<dyn Error>> {
    let mut file = format!("PF\n{} {}\n-1.0\n", image.width, image.height).into_bytes();
    for row in image.pixels.chunks_exact(image.width * 3).rev() {
        file.extend(row.iter().flat_map(|value| value.to_le_bytes()));
    }
    fs::write(path, file).map_err(|error| format!("{}: {}", path, error).into())
}

fn main() -> Result<(), Box<dyn Error>> {
    let paths: Vec<String> = env::args().skip(1).collect();
    if !(2..=4).contains(&paths.len()) {
        return Err("usage: denoise color.pfm clean.pfm [albedo.pfm [normal.pfm]]".into());
    }
    let mut image = read_pfm(&paths[0])?;
    let mut features = Vec::new();
    for path in &paths[2..] {
        let feature = read_pfm(path)?;
        if (feature.width, feature.height) != (image.width, image.height) {
            return Err(format!("{}: not of the size of {}", path, paths[0]).into());
        }
        features.push(feature.pixels);
    }
    let feature = |i: usize| features.get(i).map(Vec::as_slice);
    let mut denoiser = Denoiser::new(Options::new().hdr(true))?;
    let (width, height) = (image.width, image.height);
    denoiser.denoise_in_place(&mut image.pixels, feature(0), feature(1), width, height)?;
    write_pfm(&paths[1], &image)
}
