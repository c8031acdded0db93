//! The crate as programs use it: pixels, options, errors, threads.

use lull::{Denoiser, Error, Options, Quality};

const WIDTH: usize = 56;
const HEIGHT: usize = 40;
const FAST: &[u8] = include_bytes!("../tree/weights/kernel5_8.tza");

struct Frame {
    color: Vec<f32>,
    albedo: Vec<f32>,
    normal: Vec<f32>,
}

/// Two walls of other colours that meet at a corner, under noise; HDR.
fn frame() -> Frame {
    let mut state = 1_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut made = Frame { color: vec![], albedo: vec![], normal: vec![] };
    for pixel in 0..WIDTH * HEIGHT {
        let is_left = pixel % WIDTH < WIDTH / 2;
        let (albedo, normal) =
            if is_left { ([0.8, 0.3, 0.2], [0.6, 0.0, 0.8]) } else { ([0.7; 3], [-0.6, 0.0, 0.8]) };
        let light = 0.2 + 3.0 * noise() * noise();
        made.color.extend(albedo.map(|value: f32| value * light));
        made.albedo.extend(albedo);
        made.normal.extend(normal);
    }
    made
}

fn denoise(options: Options, frame: &Frame) -> Vec<f32> {
    let mut denoiser = Denoiser::new(options).unwrap();
    let (albedo, normal) = (Some(&frame.albedo[..]), Some(&frame.normal[..]));
    denoiser.denoise(&frame.color, albedo, normal, WIDTH, HEIGHT).unwrap()
}

fn hdr() -> Options {
    Options::new().hdr(true)
}

/// Mean square of the differences between neighbours in a row of one wall.
fn roughness(image: &[f32]) -> f32 {
    let row = &image[..(WIDTH / 2) * 3];
    row.iter().zip(&row[3..]).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() / row.len() as f32
}

#[test]
fn noise_goes() {
    let frame = frame();
    let clean = denoise(hdr(), &frame);
    assert!(roughness(&clean) < roughness(&frame.color) / 20.0);
    let mean = |image: &[f32]| image.iter().sum::<f32>() / image.len() as f32;
    assert!((mean(&clean) / mean(&frame.color) - 1.0).abs() < 0.05);
}

#[test]
fn in_place_is_the_same() {
    let frame = frame();
    let mut denoiser = Denoiser::new(hdr()).unwrap();
    let (albedo, normal) = (Some(&frame.albedo[..]), Some(&frame.normal[..]));
    for (albedo, normal) in [(None, None), (albedo, None), (albedo, normal)] {
        let clean = denoiser.denoise(&frame.color, albedo, normal, WIDTH, HEIGHT).unwrap();
        let mut color = frame.color.clone();
        denoiser.denoise_in_place(&mut color, albedo, normal, WIDTH, HEIGHT).unwrap();
        assert_eq!(color, clean);
    }
}

#[test]
fn options_reach_the_library() {
    let mut frame = frame();
    let high = denoise(hdr(), &frame);
    assert_eq!(denoise(hdr().threads(1).max_memory_mb(Some(8)), &frame), high);
    assert_eq!(denoise(hdr().quality(Quality::Auto), &frame), high); // a small frame
    let mut results = vec![
        denoise(hdr().quality(Quality::Fast), &frame),
        denoise(hdr().quality(Quality::Balanced), &frame),
        denoise(hdr().ensemble(2), &frame),
        denoise(hdr().ensemble(4), &frame),
        denoise(hdr().panorama(true), &frame),
        denoise(hdr().input_scale(Some(3.0)), &frame),
        high,
    ];
    assert_eq!(denoise(hdr().weights(FAST), &frame), results[0]);
    frame.color.iter_mut().for_each(|value| *value = value.min(1.0));
    results.push(denoise(Options::new(), &frame));
    results.push(denoise(Options::new().srgb(true), &frame));
    for (i, result) in results.iter().enumerate() {
        assert!(results[..i].iter().all(|other| other != result), "{}", i);
    }
}

#[test]
fn albedo_and_normals_alone() {
    let mut frame = frame();
    frame.albedo[300] = 1.0;
    let mut denoiser = Denoiser::new(hdr().input_scale(Some(9.0))).unwrap();
    let albedo = denoiser.denoise_albedo(&frame.albedo, WIDTH, HEIGHT).unwrap();
    let normal = denoiser.denoise_normal(&frame.normal, WIDTH, HEIGHT).unwrap();
    for (clean, noisy) in [(&albedo, &frame.albedo), (&normal, &frame.normal)] {
        let distance: f32 = clean.iter().zip(noisy).map(|(a, b)| (a - b).abs()).sum();
        assert!(distance / (noisy.len() as f32) < 0.1);
    }
    let plain = Denoiser::new(Options::new()).unwrap().denoise_albedo(&frame.albedo, WIDTH, HEIGHT);
    assert_eq!(albedo, plain.unwrap());
    let color = denoiser.denoise(&frame.color, None, None, WIDTH, HEIGHT).unwrap();
    let mut again = Denoiser::new(hdr().input_scale(Some(9.0))).unwrap();
    assert_eq!(again.denoise(&frame.color, None, None, WIDTH, HEIGHT).unwrap(), color);
}

#[test]
fn a_denoiser_may_go_to_another_thread() {
    fn is_send_and_sync<T: Send + Sync>(_: &T) {}
    let frame = frame();
    let mut denoiser = Denoiser::new(hdr()).unwrap();
    is_send_and_sync(&denoiser);
    assert_eq!(denoiser.used_quality(), None);
    let here = denoiser.denoise(&frame.color, None, None, WIDTH, HEIGHT).unwrap();
    let color = frame.color.clone();
    let there = std::thread::spawn(move || {
        let error = denoiser.denoise(&color[3..], None, None, WIDTH, HEIGHT).unwrap_err();
        assert!(error.to_string().starts_with("color: "));
        assert_eq!(denoiser.used_quality(), Some(Quality::High));
        denoiser.denoise(&color, None, None, WIDTH, HEIGHT).unwrap()
    });
    assert_eq!(there.join().unwrap(), here);
}

#[test]
fn sizes_change_and_may_be_nothing() {
    let frame = frame();
    let mut denoiser = Denoiser::new(hdr()).unwrap();
    for (width, height) in [(WIDTH, HEIGHT), (0, 0), (1, 1), (0, 9), (WIDTH, 3), (5, 1)] {
        let values = width * height * 3;
        let (color, albedo) = (&frame.color[..values], &frame.albedo[..values]);
        let clean = denoiser.denoise(color, Some(albedo), None, width, height).unwrap();
        assert_eq!(clean.len(), values);
    }
}

#[test]
fn lengths_are_checked() {
    let frame = frame();
    let (color, short) = (&frame.color[..], &frame.color[3..]);
    let (found, wanted) = (short.len(), color.len());
    let mut denoiser = Denoiser::new(hdr()).unwrap();
    let mut run = |color: &[f32], albedo, normal, width| {
        let in_place =
            denoiser.denoise_in_place(&mut color.to_vec(), albedo, normal, width, HEIGHT);
        let error = denoiser.denoise(color, albedo, normal, width, HEIGHT).unwrap_err();
        assert_eq!(in_place.unwrap_err(), error);
        error
    };
    let of = |image| Error::Length { image, found, wanted };
    assert_eq!(run(short, None, None, WIDTH), of("color"));
    assert_eq!(run(color, Some(short), None, WIDTH), of("albedo"));
    assert_eq!(run(color, None, Some(short), WIDTH), of("normal"));
    let size = Error::Size { width: usize::MAX / 8, height: HEIGHT };
    assert_eq!(run(color, None, None, usize::MAX / 8), size);
    assert_eq!(of("albedo").to_string(), "albedo: 6717 values, where 6720 are wanted");
}

#[test]
fn errors_of_options() {
    for (options, text) in [
        (hdr().srgb(true), "srgb: hdr colours are linear"),
        (hdr().ensemble(3), "ensemble: 3 is none of 1, 2, 4"),
        (hdr().threads(u32::MAX), "threads: 4294967295 is too large"),
        (hdr().max_memory_mb(Some(1 << 31)), "max_memory_mb: 2147483648 is too large"),
    ] {
        assert_eq!(Denoiser::new(options).unwrap_err(), Error::InvalidArgument(text.into()));
    }
    let _: Box<dyn std::error::Error + Send + Sync> = Error::Unknown("it is one".into()).into();
}

#[test]
fn errors_of_weights() {
    let color = frame().color;
    for bytes in [&b"no weights"[..], b"", &FAST[..1000]] {
        let mut denoiser = Denoiser::new(hdr().weights(bytes)).unwrap();
        let error = denoiser.denoise(&color, None, None, WIDTH, HEIGHT).unwrap_err();
        assert!(matches!(error, Error::InvalidOperation(_)), "{:?}", error);
        let mut same = color.clone();
        assert_eq!(denoiser.denoise_in_place(&mut same, None, None, WIDTH, HEIGHT), Err(error));
        assert_eq!(same, color);
    }
}
