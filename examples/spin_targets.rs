//! quick
use rayon::prelude::*;
use spindoe::spin::{quatera::*, robust::*, simulate::*};
fn main() {
    let n = 10_000u64;
    let s = Scenario::default();
    for rps in [
        (1.0, 10.0),
        (10.0, 50.0),
        (50.0, 100.0),
        (100.0, 140.0),
        (140.0, 170.0),
    ] {
        let r: Vec<_> = (0..n)
            .into_par_iter()
            .map_init(
                || {
                    (
                        RobustEstimator::new(RobustOptions::default()),
                        QuateraEstimator::new(QuateraOptions::default()),
                    )
                },
                |(a, b), i| {
                    let q = s.sequence(rps, 1, i);
                    let w = q.truth.spin;
                    let f = |x: Result<spindoe::spin::Fit, _>| {
                        x.map(|f: spindoe::spin::Fit| {
                            (
                                (f.motion.spin - w).norm() / w.norm(),
                                (f.motion.spin.norm() - w.norm()).abs() / w.norm(),
                            )
                        })
                        .unwrap_or((9.0, 9.0))
                    };
                    (f(a.fit(&q.measurements)), f(b.fit(&q.measurements)))
                },
            )
            .collect();
        let frac = |g: &dyn Fn(&((f64, f64), (f64, f64))) -> f64| {
            r.iter().filter(|x| g(x) < 0.2).count() as f64 / n as f64
        };
        let med = |g: &dyn Fn(&((f64, f64), (f64, f64))) -> f64| {
            let mut v: Vec<f64> = r.iter().map(g).collect();
            v.sort_by(f64::total_cmp);
            v[v.len() / 2]
        };
        println!(
            "{rps:?} robust vec {:.4} mag {:.4} med {:.4} | quatera vec {:.4} mag {:.4} med {:.4}",
            frac(&|x| x.0.0),
            frac(&|x| x.0.1),
            med(&|x| x.0.1),
            frac(&|x| x.1.0),
            frac(&|x| x.1.1),
            med(&|x| x.1.1)
        );
    }
}
