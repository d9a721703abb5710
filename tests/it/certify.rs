//! Certificates: against brute force over all small sets of dots, and against tampering.

use std::path::Path;

use spindoe::Pattern;
use spindoe::certify::{Certificate, CertifyConfig, TakenFor, certify, is_guaranteed};
use spindoe::geometry::{Vec3, angle_between, kabsch, spiral_directions};

use crate::common::{done, random_pattern, spindoe};

/// The smallest largest angle between dots and others over all rotations, by C. L. Lawson's
/// reweighting: dots that are farther off weigh more in the next fit.
fn minimax(seen: &[Vec3], others: &[Vec3]) -> f64 {
    let mut weights = vec![1.0; seen.len()];
    let mut best = f64::INFINITY;
    for _ in 0..60 {
        let Ok(rotation) = kabsch(seen, others, Some(&weights)) else {
            break;
        };
        let off: Vec<f64> = seen
            .iter()
            .zip(others)
            .map(|(s, o)| angle_between(&(rotation * s), o))
            .collect();
        best = best.min(off.iter().copied().fold(0.0, f64::max));
        for (w, off) in weights.iter_mut().zip(&off) {
            *w *= off + 1e-12;
        }
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w *= 3.0 / sum);
    }
    best
}

/// All ordered choices of `k` of `n` numbers.
fn choices(n: usize, k: usize) -> Vec<Vec<usize>> {
    (0..k).fold(vec![Vec::new()], |all, _| {
        all.iter()
            .flat_map(|c| {
                (0..n)
                    .filter(|i| !c.contains(i))
                    .map(|i| [c.as_slice(), &[i]].concat())
            })
            .collect()
    })
}

/// Half the distance to the nearest confusion of `k` dots, over all sets that a view shows.
fn brute_force(dots: &[Vec3], limit: f64, k: usize, taken_for: TakenFor) -> f64 {
    let sign = if taken_for == TakenFor::Mirrored {
        -1.0
    } else {
        1.0
    };
    let views: Vec<Vec3> = spiral_directions(4_000).collect();
    let all = choices(dots.len(), k);
    let mut best = f64::INFINITY;
    for seen in all.iter().filter(|c| c.is_sorted()) {
        if !views
            .iter()
            .any(|v| seen.iter().all(|&i| dots[i].dot(v) >= limit))
        {
            continue;
        }
        let from: Vec<Vec3> = seen.iter().map(|&i| dots[i]).collect();
        for other in all.iter().filter(|other| sign < 0.0 || *other != seen) {
            let to: Vec<Vec3> = other.iter().map(|&j| sign * dots[j]).collect();
            best = best.min(0.5 * minimax(&from, &to));
        }
    }
    best
}

#[test]
fn guarantees_agree_with_brute_force() {
    let config = CertifyConfig {
        tolerance_rad: 0.05f64.to_radians(),
        ..CertifyConfig::default()
    };
    for (n, seed) in [(6, 1), (7, 2)] {
        let pattern = random_pattern(n, seed);
        let certificate = certify(&pattern, &config).unwrap();
        for taken_for in TakenFor::ALL {
            for k in [3, 4] {
                let Some(found) = certificate.guarantee(taken_for, k) else {
                    continue;
                };
                // The samples of views miss sets that are visible from few: they can only find more.
                let inner =
                    brute_force(pattern.dots(), config.visibility_limit + 0.03, k, taken_for);
                let outer =
                    brute_force(pattern.dots(), config.visibility_limit - 0.03, k, taken_for);
                // Reweighting stops a little above the minimum.
                assert!(
                    found.guaranteed_rad <= inner + 1e-9,
                    "{n} {taken_for:?} {k}: {found:?} {inner}"
                );
                assert!(
                    found.confused_rad >= outer - 0.2f64.to_radians(),
                    "{n} {taken_for:?} {k}: {found:?} {outer}"
                );
                assert!(found.confused_rad - found.guaranteed_rad <= config.tolerance_rad + 1e-12);
            }
        }
        certificate.check(&pattern).unwrap();
    }
}

#[test]
fn guarantees_grow_with_the_number_of_detected_dots() {
    let pattern = random_pattern(12, 3);
    let certificate = certify(&pattern, &CertifyConfig::default()).unwrap();
    for taken_for in TakenFor::ALL {
        let angles: Vec<f64> = (3..=8)
            .filter_map(|k| certificate.guarantee(taken_for, k))
            .map(|g| g.confused_rad)
            .collect();
        let tolerance = 2.0 * CertifyConfig::default().tolerance_rad;
        assert!(
            angles.windows(2).all(|w| w[1] >= w[0] - tolerance),
            "{angles:?}"
        );
    }
    let four = certificate.guarantee(TakenFor::Others, 4).unwrap();
    let limit = certificate.visibility_limit;
    assert!(is_guaranteed(&pattern, limit, 4, four.guaranteed_rad).unwrap());
    assert!(!is_guaranteed(&pattern, limit, 4, four.confused_rad + 1e-6).unwrap());
}

/// A cube looks the same from six sides: nothing is guaranteed.
#[test]
fn a_symmetric_pattern_has_no_guarantee() {
    let s = 1.0 / 3f64.sqrt();
    let dots = (0..8).map(|k| {
        let sign = |bit: usize| if k >> bit & 1 == 0 { s } else { -s };
        Vec3::new(sign(0), sign(1), sign(2))
    });
    let pattern = Pattern::new(dots.collect()).unwrap();
    let certificate = certify(&pattern, &CertifyConfig::default()).unwrap();
    assert!(!certificate.guarantees.is_empty());
    assert!(
        certificate
            .guarantees
            .iter()
            .all(|g| g.guaranteed_rad < 1e-3)
    );
}

#[test]
fn tampered_certificates_are_refused() {
    let pattern = random_pattern(9, 5);
    let certificate = certify(&pattern, &CertifyConfig::default()).unwrap();
    certificate.check(&pattern).unwrap();
    let refused = |change: &dyn Fn(&mut Certificate)| {
        let mut tampered = certificate.clone();
        change(&mut tampered);
        assert!(tampered.check(&pattern).unwrap_err().is_usage());
    };
    refused(&|c| c.guarantees[1].guaranteed_rad += 0.002);
    refused(&|c| c.guarantees[0].seen[0] = c.guarantees[0].seen[1]);
    refused(&|c| c.guarantees[2].rotation = [1.0, 0.0, 0.0, 0.0]);
    refused(&|c| c.min_visible += 1);
    refused(&|c| c.visibility_limit = f64::NAN);
    // Another pattern, and one of which a dot was moved.
    assert!(certificate.check(&random_pattern(9, 6)).is_err());
    let mut dots = pattern.dots().to_vec();
    dots[0] = (dots[0] + 1e-6 * Vec3::x()).normalize();
    assert!(certificate.check(&Pattern::new(dots).unwrap()).is_err());
}

#[test]
fn the_command_writes_and_verifies_certificates() {
    let dir = tempfile::tempdir().unwrap();
    let dir: &Path = dir.path();
    random_pattern(8, 7)
        .write_csv(&dir.join("pattern.csv"))
        .unwrap();
    random_pattern(8, 8)
        .write_csv(&dir.join("other.csv"))
        .unwrap();
    let words = done(dir, &["certify", "pattern.csv", "-o", "certificate.json"]);
    assert!(words.contains("No confusion while"), "{words}");
    let json = done(
        dir,
        &[
            "certify",
            "pattern.csv",
            "--check",
            "certificate.json",
            "--json",
        ],
    );
    let found: Certificate = serde_json::from_str(&json).unwrap();
    assert_eq!(
        found,
        Certificate::read(&dir.join("certificate.json")).unwrap()
    );
    let output = spindoe(
        dir,
        &["certify", "other.csv", "--check", "certificate.json"],
    );
    assert_eq!(output.status.code(), Some(2));
    let output = spindoe(dir, &["certify", "pattern.csv", "--tolerance-deg", "0"]);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        words.contains("--tolerance-deg") && output.status.code() == Some(2),
        "{words}"
    );
}
