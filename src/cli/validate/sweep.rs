//! One pattern over a range of the dots' noise, and of the paper's alpha.

use super::{Arguments, Sweep};
use crate::ball::Ball;
use crate::cli::output::Counter;
use crate::cli::print_json;
use crate::error::Result;
use crate::files;
use crate::validate::{SensitivityConfig, sensitivity, sensitivity_csv};

pub(super) fn run(arguments: &Arguments, ball: &Ball) -> Result<()> {
    arguments.reject("with a sweep", &["recognizer", "sigma-deg"])?;
    let sigmas_deg = match arguments.sweep.contains(&Sweep::Noise) {
        true => arguments.sweep_noise_deg.clone(),
        false => Vec::new(),
    };
    let config = SensitivityConfig {
        sigmas_deg,
        alphas: arguments.sweep_alpha.clone(),
        samples: arguments
            .samples
            .unwrap_or(SensitivityConfig::default().samples),
        seed: arguments.seed,
        ..SensitivityConfig::default()
    };
    let set = arguments.begin()?;
    let protocol = arguments.protocol();
    let counter = Counter::new(config.points() as u64, "points");
    let points = sensitivity(ball, &protocol, &config, None, &mut |_| {
        counter.add(1);
        Ok(())
    })?;
    counter.finish();
    if let Some(set) = set {
        let csv = sensitivity_csv(&points);
        files::write_bytes(&set.path().join("sensitivity.csv"), csv.as_bytes())?;
        #[cfg(feature = "plot")]
        {
            use crate::report::plots::{PictureFormat, sensitivity_plots};
            sensitivity_plots(set.path(), &points, &[PictureFormat::Png])?;
        }
        set.publish(&[], "sensitivity.csv")?;
    }
    if arguments.json {
        return print_json(&serde_json::json!({ "points": points }));
    }
    outln!(
        "protocol {}, {} trials a point, seed {}",
        protocol.name(),
        config.samples,
        config.seed
    );
    for p in &points {
        let v = &p.result.validation;
        outln!(
            "{:<9} {:>6}  {:<6}  right {}  all dots, of views with enough, {}",
            p.parameter.as_str(),
            p.value,
            p.result.recognizer,
            v.answered,
            v.identity
        );
    }
    Ok(())
}
