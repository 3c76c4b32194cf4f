//! The `spykee` command.

fn main() -> std::process::ExitCode {
    spykee::cli::main()
}
