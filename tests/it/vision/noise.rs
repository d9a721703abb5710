//! Images without a ball: noise of several sizes and spectra is refused.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::image::{GrayImage, ImageView};
use spindoe::synth::dataset::independent_frame;
use spindoe::synth::{SynthConfig, SynthKind};
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

use crate::common::ball::blur;

const SIDES: [usize; 4] = [44, 64, 96, 150];

/// How noise is spread over frequencies.
#[derive(Debug, Clone, Copy)]
enum Spectrum {
    White,
    /// White noise after a Gaussian of this standard deviation, pixels.
    Blurred(f64),
    /// The same power in every octave.
    Pink,
}

fn white(side: usize, rng: &mut ChaCha8Rng) -> GrayImage {
    let values = (0..side * side).map(|_| rng.random()).collect();
    GrayImage::new(side, side, values).expect("as many values")
}

/// Values about a mean of 0.5 with the given standard deviation.
fn scaled(image: &GrayImage, deviation: f32) -> GrayImage {
    let values = image.values();
    let count = values.len() as f32;
    let mean = values.iter().sum::<f32>() / count;
    let spread = (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / count).sqrt();
    let scale = deviation / spread;
    let scaled = values
        .iter()
        .map(|v| (0.5 + scale * (v - mean)).clamp(0.0, 1.0));
    GrayImage::new(image.width(), image.height(), scaled.collect()).expect("as many values")
}

fn noise(side: usize, spectrum: Spectrum, rng: &mut ChaCha8Rng) -> GrayImage {
    let deviation = 0.02 + 0.28 * rng.random::<f32>();
    let image = match spectrum {
        Spectrum::White => white(side, rng),
        Spectrum::Blurred(sigma) => blur(&white(side, rng), sigma),
        Spectrum::Pink => {
            let octaves = [0.0, 1.0, 2.0, 4.0, 8.0].map(|sigma| {
                let octave = blur(&white(side, rng), sigma);
                scaled(&octave, 0.1)
            });
            GrayImage::from_fn(side, side, |u, v| {
                octaves.iter().map(|o| o.values()[v * side + u]).sum()
            })
        }
    };
    scaled(&image, deviation)
}

fn estimator() -> Estimator {
    let pattern = crate::common::random_pattern(20, 5);
    let detector = DetectorName::Cnn.build().expect("weights");
    Estimator::new(&pattern, EstimatorConfig::default(), detector).expect("valid settings")
}

/// Confidences of the answers given.
fn answers<'a>(images: impl Iterator<Item = ImageView<'a>>) -> (usize, Vec<f64>) {
    let estimator = estimator();
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    let (mut all, mut answered) = (0, Vec::new());
    for image in images {
        estimator.estimate(
            image,
            &Prior::default(),
            &Budget::default(),
            &mut ws,
            &mut out,
        );
        all += 1;
        answered.extend(out.pose().map(|p| p.confidence));
    }
    println!("{} of {all} answered: {answered:.4?}", answered.len());
    (all, answered)
}

#[test]
fn noise_is_refused() {
    let mut rng = ChaCha8Rng::seed_from_u64(150);
    let spectra = [
        Spectrum::White,
        Spectrum::Blurred(1.0),
        Spectrum::Blurred(2.0),
        Spectrum::Blurred(4.0),
        Spectrum::Pink,
    ];
    let each = crate::common::few_or_all(3, 6);
    let mut images = Vec::new();
    for side in SIDES {
        for spectrum in spectra {
            images.extend((0..each).map(|_| noise(side, spectrum, &mut rng)));
        }
    }
    let (all, answered) = answers(images.iter().map(ImageView::from));
    assert_eq!(all, 20 * each);
    assert!(answered.len() <= 1, "{answered:?}");
}

#[test]
fn rendered_noise_is_refused() {
    let pattern = crate::common::random_pattern(20, 5);
    let config = SynthConfig {
        kind: SynthKind::Noise,
        ..SynthConfig::default()
    };
    let frames: Vec<_> = (0..crate::common::few_or_all(40, 100))
        .map(|k| independent_frame(&pattern, &config, 151, k).expect("a frame"))
        .collect();
    let (_, answered) = answers(frames.iter().map(|f| ImageView::from(&f.image)));
    assert!(answered.len() <= 1, "{answered:?}");
    assert!(answered.iter().all(|c| *c < 0.9), "{answered:?}");
}
