//! The flashes of an exposure on the command line: their times in milliseconds, or a period and their number.

use std::str::FromStr;

/// Flashes of a period, at most: more than any exposure may have.
const MOST: u32 = 8;

/// Times of the flashes of an exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct Flashes {
    /// Seconds.
    pub times_s: Vec<f64>,
}

impl FromStr for Flashes {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let ms = |word: &str| {
            let parsed = word.trim().parse::<f64>();
            parsed.map_err(|_| format!("expected milliseconds, found {word:?}"))
        };
        let times_ms: Vec<f64> = match text.split_once('x') {
            Some((period, count)) => {
                let (period, parsed) = (ms(period)?, count.trim().parse::<u32>());
                let count = parsed.map_err(|_| {
                    format!("expected a number of flashes after x, found {count:?}")
                })?;
                // More than a few are refused with the times, which are printed then.
                if count > MOST {
                    return Err(format!("expected at most {MOST} flashes, found {count}"));
                }
                (0..count).map(|k| period * f64::from(k)).collect()
            }
            None => text.split(',').map(ms).collect::<Result<_, _>>()?,
        };
        Ok(Self {
            times_s: times_ms.into_iter().map(|ms| 1e-3 * ms).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_periods_are_read() {
        let times = |text: &str| text.parse::<Flashes>().map(|f| f.times_s);
        for (text, expected) in [
            ("0,0.9,2.1", [0.0, 0.9e-3, 2.1e-3]),
            ("0.5x3", [0.0, 0.5e-3, 1e-3]),
        ] {
            let found = times(text).expect("times of flashes");
            assert_eq!(found.len(), 3, "{text}");
            // Milliseconds are no whole numbers of bits.
            let is_near = |(a, b): (&f64, f64)| (a - b).abs() < 1e-15;
            assert!(found.iter().zip(expected).all(is_near), "{found:?}");
        }
        for wrong in [
            "",
            "0,",
            "x3",
            "0.5x",
            "0.5x-1",
            "1;2",
            "0.5x3x2",
            "0.7x1000000000",
        ] {
            assert!(times(wrong).is_err(), "{wrong}");
        }
    }
}
