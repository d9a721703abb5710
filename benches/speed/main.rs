//! How fast everything is, in one table, within two minutes after the build; then the scaling:
//!
//!     cargo bench                                   # all
//!     cargo bench -- spin                           # what has `spin` in its name
//!     cargo bench -- --save-baseline before         # then change something, and
//!     cargo bench -- --baseline before
//!
//! The table says how long each thing takes, how that compares with the run before (or with the saved one), and with the
//! faithful baseline of the paper's method, which is measured beside it. Then: how cost grows with the input's size
//! (`cargo bench -- scaling` for that alone). Times are wall time: only those of an idle machine mean anything.

mod design;
mod recognize;
mod scaling;
mod spin;
mod stencil;
mod table;
mod vision;

use std::path::Path;
use std::time::Duration;

use criterion::Criterion;

use table::Table;

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn main() -> Outcome {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let is_scaling_alone = arguments.iter().any(|a| a == "scaling");
    if !is_scaling_alone {
        let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("criterion");
        let mut criterion = Criterion::default()
            .output_directory(&directory)
            .warm_up_time(Duration::from_millis(300))
            .measurement_time(Duration::from_millis(1500))
            .sample_size(20)
            .configure_from_args();
        let mut table = Table::new(directory);
        recognize::run(&mut criterion, &mut table)?;
        design::run(&mut criterion, &mut table)?;
        spin::run(&mut criterion, &mut table);
        stencil::run(&mut criterion, &mut table)?;
        vision::run(&mut criterion, &mut table)?;
        criterion.final_summary();
        table.print();
    }
    // Cargo passes `--bench`; whatever else was asked for was something else.
    if is_scaling_alone || arguments == ["--bench"] {
        scaling::run()?;
    }
    Ok(())
}
