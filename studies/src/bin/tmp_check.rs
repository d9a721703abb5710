#![allow(missing_docs, clippy::unwrap_used)]
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::design::objective::Coincidence;
use spindoe::geometry::{Vec3, tangent_frame};
use spindoe::pattern::random_pattern;
use std::time::Instant;

fn main() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for (n, sep) in [(9usize, 0.4), (20, 0.31), (32, 0.25), (64, 0.15)] {
        let p = random_pattern(n, sep, &mut rng).unwrap();
        for sigma in [0.016, 0.035] {
            for given in [None, Some(4)] {
                let o = Coincidence { sigma_rad: sigma, given, ..Coincidence::default() };
                let mut best = f64::INFINITY;
                let mut e = o.evaluate(p.dots());
                for _ in 0..5 {
                    let t = Instant::now();
                    e = o.evaluate(p.dots());
                    best = best.min(t.elapsed().as_secs_f64());
                }
                let largest = e.gradient.iter().map(Vec3::norm).fold(0.0, f64::max);
                let h = 1e-6;
                let mut worst = 0.0f64;
                for i in [0, 1, n / 2] {
                    for axis in tangent_frame(&p.dots()[i]) {
                        let value = |step: f64| {
                            let mut m = p.dots().to_vec();
                            m[i] = (m[i] + step * axis).normalize();
                            o.evaluate(&m).value
                        };
                        let numeric = (value(h) - value(-h)) / (2.0 * h);
                        worst = worst.max((numeric - e.gradient[i].dot(&axis)).abs());
                    }
                }
                println!("n {n} sigma {sigma} given {given:?}: value {:.5} {:.2} ms; slope {largest:.4}, worst error {:.2e}", e.value, 1e3 * best, worst / largest);
            }
        }
    }
}
