//! Writes the stencil of a pattern: `make_stencil PATTERN.csv DIR`.

use std::path::Path;

use spindoe::pattern::Pattern;
use spindoe::stencil::{Stencil, StencilConfig};

fn main() -> spindoe::Result<()> {
    let args: Vec<String> = std::env::args().collect();
    let [_, pattern, dir] = args.as_slice() else {
        return Err(spindoe::Error::argument(
            "arguments",
            "expected PATTERN.csv DIR",
        ));
    };
    let pattern = Pattern::read_csv(Path::new(pattern))?;
    let start = std::time::Instant::now();
    let stencil = Stencil::build(&pattern, &StencilConfig::default())?;
    println!("built in {:.2} s", start.elapsed().as_secs_f64());
    for half in stencil.halves() {
        println!("{:?}", half.check);
    }
    stencil.write(Path::new(dir))
}
