//! `--firmware FILE.yaml`: what a simulated robot does where the real one's behaviour is unknown.

use std::path::PathBuf;

use super::Failure;
use crate::sim::Firmware;

/// Which firmware a simulated robot has.
#[derive(Debug, Clone, Default, clap::Args)]
pub(super) struct FirmwareArgs {
    /// YAML file that sets how the simulated robot behaves where the real firmware is unknown; the
    /// README lists the keys
    #[arg(long, value_name = "FILE.yaml")]
    firmware: Option<PathBuf>,
}

impl FirmwareArgs {
    /// The file's, or the default.
    ///
    /// # Errors
    /// What is wrong with the file, and where.
    pub(super) fn load(&self) -> Result<Firmware, Failure> {
        let Some(path) = &self.firmware else {
            return Ok(Firmware::default());
        };
        Firmware::load(path).map_err(|error| {
            Failure::usage(error).help("the README's section on firmware lists all keys")
        })
    }

    /// A real robot has its own.
    ///
    /// # Errors
    /// One was asked for, and the robot is not simulated.
    pub(super) fn refuse_unless(&self, simulated: bool) -> Result<(), Failure> {
        if simulated || self.firmware.is_none() {
            return Ok(());
        }
        let failure = Failure::usage("--firmware needs --sim: it describes a simulated robot");
        Err(failure.help("--sim [WORLD.yaml] runs on a simulated robot"))
    }
}
