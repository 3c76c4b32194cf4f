//! The enumerated values of STREAMCTL, LED, PLAY, ENGINE and AUTH_REPLY (`PROTOCOL.md`) and their
//! names in scripts.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Declares an enum of one wire byte with named values, and `Unknown` for all other bytes.
macro_rules! wire_byte {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $byte:literal, $text:literal;)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum $name {
            $($(#[$variant_doc])* #[doc = concat!("Byte ", stringify!($byte), ", `", $text, "`.")] $variant,)+
            /// A byte that the protocol's table does not list.
            Unknown(u8),
        }

        impl $name {
            /// Every value that the protocol's table lists, in the table's order.
            pub const ALL: &'static [$name] = &[$($name::$variant,)+];

            /// The byte on the wire.
            pub fn to_byte(self) -> u8 {
                match self {
                    $($name::$variant => $byte,)+
                    $name::Unknown(byte) => byte,
                }
            }

            /// The name that scripts and users use; `unknown` for a byte that is not in the table.
            pub fn name(self) -> &'static str {
                match self {
                    $($name::$variant => $text,)+
                    $name::Unknown(_) => "unknown",
                }
            }

            /// The value with this name in the table.
            pub fn from_name(name: &str) -> Option<$name> {
                $name::ALL.iter().copied().find(|value| value.name() == name)
            }
        }

        impl From<u8> for $name {
            fn from(byte: u8) -> $name {
                match byte {
                    $($byte => $name::$variant,)+
                    other => $name::Unknown(other),
                }
            }
        }

        /// The name in formats that people read, else the byte.
        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
                if to.is_human_readable() {
                    to.serialize_str(self.name())
                } else {
                    to.serialize_u8(self.to_byte())
                }
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(from: D) -> Result<$name, D::Error> {
                if !from.is_human_readable() {
                    return Ok($name::from(u8::deserialize(from)?));
                }
                let name = String::deserialize(from)?;
                $name::from_name(&name).ok_or_else(|| {
                    let names: Vec<&str> = $name::ALL.iter().map(|value| value.name()).collect();
                    let shown: String = name.chars().take(40).collect();
                    D::Error::custom(format_args!("no `{shown}` among: {}", names.join(", ")))
                })
            }
        }
    };
}

wire_byte! {
    /// A stream that STREAMCTL switches (`PROTOCOL.md`, STREAMCTL).
    Stream {
        /// From the camera to the agent.
        Video = 1, "video";
        /// From the microphone to the agent.
        AudioIn = 2, "audio_in";
        /// From the agent to the speaker.
        AudioOut = 3, "audio_out";
    }
}

wire_byte! {
    /// A light that LED switches (`PROTOCOL.md`, LED).
    Led {
        /// The headlight in the centre.
        Flash = 0, "flash";
        Left = 1, "left";
        Right = 2, "right";
    }
}

wire_byte! {
    /// A sound that PLAY plays (`PROTOCOL.md`, PLAY).
    Sound {
        Alarm = 0, "alarm";
        Bomb = 1, "bomb";
        /// lazer.mp3
        Laser = 2, "laser";
        /// ah-ah-ah.mp3
        Laugh = 3, "laugh";
        Engine = 4, "engine";
        Robot = 5, "robot";
        /// Uploaded by the user.
        User0 = 6, "user0";
        /// Uploaded by the user.
        User1 = 7, "user1";
        /// camera.mp3
        Snapshot = 16, "snapshot";
        /// bip.mp3; also flips a recording flag of unknown effect
        Record = 17, "record";
        Bip2 = 18, "bip_2";
        Bip3 = 19, "bip_3";
        Bip4 = 20, "bip_4";
        /// The uploaded music file.
        Music = 64, "music";
    }
}

wire_byte! {
    /// The request in an ENGINE message to the robot (`PROTOCOL.md`, ENGINE).
    Engage {
        /// CHARGE_STOP: leave the station.
        Undock = 5, "undock";
        /// BASE_FIND: search for the station and drive onto it.
        Dock = 6, "dock";
        /// BASE_FIND_CANCEL: stop searching.
        CancelDock = 7, "cancel_dock";
    }
}

wire_byte! {
    /// The event in an ENGINE message from the robot (`PROTOCOL.md`, ENGINE).
    EngineReport {
        /// ACTIVATE: the robot has left the charging station.
        Undocked = 1, "undocked";
        /// DEACTIVATE: the robot is on the charging station.
        Docked = 2, "docked";
        /// BATTERY_CHARGED: the battery is full.
        Charged = 3, "charged";
        /// The search failed.
        BaseNotFound = 8, "base_not_found";
    }
}

wire_byte! {
    /// Why a login was refused (`PROTOCOL.md`, AUTH_REPLY).
    Refusal {
        /// Wrong user or password.
        WrongPassword = 1, "password";
        /// Another user is connected.
        InUse = 3, "busy";
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_the_round_trip() {
        for byte in 0..=u8::MAX {
            assert_eq!(Stream::from(byte).to_byte(), byte);
            assert_eq!(Led::from(byte).to_byte(), byte);
            assert_eq!(Sound::from(byte).to_byte(), byte);
            assert_eq!(Engage::from(byte).to_byte(), byte);
            assert_eq!(EngineReport::from(byte).to_byte(), byte);
            assert_eq!(Refusal::from(byte).to_byte(), byte);
        }
    }

    #[test]
    fn json_has_the_names() {
        assert_eq!(serde_json::to_string(&Led::Flash).unwrap(), "\"flash\"");
        let back: Sound = serde_json::from_str("\"bip_2\"").unwrap();
        assert_eq!(back, Sound::Bip2);
        let error = serde_json::from_value::<Led>("top".into()).unwrap_err();
        assert_eq!(error.to_string(), "no `top` among: flash, left, right");
    }

    #[test]
    fn names_map_back_to_their_values() {
        for &sound in Sound::ALL {
            assert_eq!(Sound::from_name(sound.name()), Some(sound));
        }
        assert_eq!(Sound::from_name("unknown"), None);
        assert_eq!(Sound::Unknown(99).name(), "unknown");
        assert_eq!(Sound::from(64), Sound::Music);
        assert_eq!(Led::from_name("flash"), Some(Led::Flash));
    }
}
