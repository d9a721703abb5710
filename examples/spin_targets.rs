//! quick
use rayon::prelude::*;
use spindoe::spin::{bound::*, quatera::*, robust::*, simulate::*};
fn main() {
    let n = 10_000u64;
    let known = std::env::args().any(|a| a == "known");
    let s = Scenario::default();
    let mut o = RobustOptions::default();
    if known {
        o.sigma_degrees = f64::INFINITY;
    }
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
                || RobustEstimator::new(o),
                |a, i| {
                    let q = s.sequence(rps, 1, i);
                    let w = q.truth.spin;
                    let b = SpinBound::of(&w, &q.measurements, s.sigma_rad, |i| !q.outlier[i]);
                    let p = b.map_or(0.0, |b| b.probability_within(0.2 * w.norm()));
                    match a.fit(&q.measurements) {
                        Ok(f) => {
                            let e = f.motion.spin - w;
                            let c = f.spin_covariance.unwrap();
                            let z2 = c.cholesky().unwrap().solve(&e).dot(&e) / 3.0;
                            (
                                e.norm() / w.norm(),
                                p,
                                e.norm_squared(),
                                b.unwrap().mean_square(),
                                z2,
                            )
                        }
                        Err(_) => (9.0, p, 0.0, 0.0, 0.0),
                    }
                },
            )
            .collect();
        let ok: Vec<_> = r.iter().filter(|x| x.0 < 0.2).collect();
        let all: Vec<_> = r.iter().filter(|x| x.0 < 9.0).collect();
        let m = |v: &Vec<&(f64, f64, f64, f64, f64)>,
                 g: &dyn Fn(&(f64, f64, f64, f64, f64)) -> f64| {
            v.iter().map(|x| g(x)).sum::<f64>() / v.len() as f64
        };
        println!(
            "{rps:?} vec {:.4} allowed {:.4} | rms/crb ok {:.4} all {:.4} | z2 ok {:.4} all {:.4} fail {}",
            ok.len() as f64 / n as f64,
            r.iter().map(|x| x.1).sum::<f64>() / n as f64,
            (m(&ok, &|x| x.2) / m(&ok, &|x| x.3)).sqrt(),
            (m(&all, &|x| x.2) / m(&all, &|x| x.3)).sqrt(),
            m(&ok, &|x| x.4),
            m(&all, &|x| x.4),
            r.len() - all.len()
        );
    }
    let q: Vec<_> = (0..1000).map(|i| s.sequence((1.0, 170.0), 5, i)).collect();
    let mut a = RobustEstimator::new(o);
    let mut b = QuateraEstimator::new(QuateraOptions::default());
    let mut ta = vec![];
    let mut tb = vec![];
    for q in &q {
        let t = std::time::Instant::now();
        let _ = std::hint::black_box(a.fit(&q.measurements));
        ta.push(t.elapsed().as_nanos());
        let t = std::time::Instant::now();
        let _ = std::hint::black_box(b.fit(&q.measurements));
        tb.push(t.elapsed().as_nanos());
    }
    ta.sort();
    tb.sort();
    println!(
        "robust median {} p99 {} ns, quatera {} ns",
        ta[500], ta[990], tb[500]
    );
}
