//! Noise without a ball, of five spectra: white; white after a Gaussian of 1, 2 and 4 px; pink.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Standard deviations of the blur of white noise, pixels; the last spectrum is the sum of octaves.
const BLURS: [f64; 4] = [0.0, 1.0, 2.0, 4.0];
const OCTAVES: [f64; 5] = [0.0, 1.0, 2.0, 4.0, 8.0];

/// White noise after a Gaussian, mean 0 and standard deviation 1.
fn blurred(side: usize, sigma: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let mut values: Vec<f64> = (0..side * side).map(|_| rng.random::<f64>()).collect();
    if sigma > 0.0 {
        let half = (3.0 * sigma).ceil() as isize;
        let weight = |k: isize| (-0.5 * (k as f64 / sigma).powi(2)).exp();
        // Wrapped around: noise without a border.
        let wrap = |x: isize| x.rem_euclid(side as isize) as usize;
        for (du, dv) in [(1, 0), (0, 1)] {
            let before = values.clone();
            for (i, value) in values.iter_mut().enumerate() {
                let (u, v) = ((i % side) as isize, (i / side) as isize);
                let at = |k: isize| before[wrap(v + k * dv) * side + wrap(u + k * du)];
                *value = (-half..=half).map(|k| weight(k) * at(k)).sum();
            }
        }
    }
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let spread = (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt();
    values.iter().map(|x| (x - mean) / spread).collect()
}

/// An image of noise.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseField {
    /// Its side, pixels.
    pub side: usize,
    /// Its gray values in [0, 1], row after row.
    pub values: Vec<f32>,
}

impl NoiseField {
    /// A field of 40 to 200 px and any contrast; `k` chooses the spectrum.
    pub fn random(rng: &mut ChaCha8Rng, k: u64) -> Self {
        let side = (40.0 * 5f64.powf(rng.random())) as usize;
        let deviation = rng.random_range(0.02..0.3);
        let values = match BLURS.get((k % 5) as usize) {
            Some(sigma) => blurred(side, *sigma, rng),
            None => {
                let mut sum = vec![0.0; side * side];
                for sigma in OCTAVES {
                    let octave = blurred(side, sigma, rng);
                    sum.iter_mut().zip(octave).for_each(|(s, x)| *s += x);
                }
                let root = (OCTAVES.len() as f64).sqrt();
                sum.iter_mut().for_each(|s| *s /= root);
                sum
            }
        };
        let gray = |x: &f64| (0.5 + deviation * x).clamp(0.0, 1.0) as f32;
        Self {
            side,
            values: values.iter().map(gray).collect(),
        }
    }
}
