//! The `spindoe` command: a thin layer over the library.

fn main() -> std::process::ExitCode {
    spindoe::cli::main()
}
