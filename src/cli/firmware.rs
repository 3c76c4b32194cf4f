//! `--firmware FILE.yaml`: how a simulated robot behaves where the real one's behaviour is unknown.

use std::path::PathBuf;

use super::Failure;
use crate::sim::Firmware;

/// The firmware of a simulated robot.
#[derive(Debug, Clone, Default, clap::Args)]
pub(super) struct FirmwareArgs {
    /// YAML file with the simulated robot's behaviour where the real firmware is unknown; the README
    /// lists the keys
    #[arg(long, value_name = "FILE.yaml")]
    firmware: Option<PathBuf>,
}

impl FirmwareArgs {
    /// Loads the firmware from the file, or returns the default.
    ///
    /// # Errors
    /// An invalid file; the error says what is wrong and where.
    pub(super) fn load(&self) -> Result<Firmware, Failure> {
        let Some(path) = &self.firmware else {
            return Ok(Firmware::default());
        };
        Firmware::load(path).map_err(|error| {
            Failure::usage(error).help("the README's section on firmware lists all keys")
        })
    }

    /// Refuses the flag for a real robot, which has its own firmware.
    ///
    /// # Errors
    /// The flag was given and the robot is not simulated.
    pub(super) fn refuse_unless(&self, simulated: bool) -> Result<(), Failure> {
        if simulated || self.firmware.is_none() {
            return Ok(());
        }
        let failure = Failure::usage("--firmware needs --sim: it describes a simulated robot");
        Err(failure.help("--sim [WORLD] runs on a simulated robot"))
    }
}
