//! The systemd unit of the service.

use std::path::Path;

/// The settings of the unit that differ between installations.
#[derive(Debug, Clone)]
pub struct Unit<'a> {
    pub program: &'a Path,
    pub config: &'a Path,
    /// A file with the robot's password, which systemd passes to the service; `None`: the robot's
    /// default password.
    pub password: Option<&'a Path>,
    /// The user that runs the service; `None`: systemd creates one, called spykee.
    pub user: Option<&'a str>,
}

pub fn unit(unit: &Unit<'_>) -> String {
    let program = escaped(unit.program);
    let config = escaped(unit.config);
    let password = unit.password.map_or_else(String::new, |path| {
        format!("LoadCredential=password:{}\n", escaped(path))
    });
    let user = match unit.user {
        Some(name) => format!("User={}", name.replace('%', "%%")),
        None => "DynamicUser=yes\nUser=spykee".to_owned(),
    };
    TEMPLATE
        .replace("@USER@", &user)
        .replace("@PROGRAM@", &program)
        .replace("@CONFIG@", &config)
        .replace("@PASSWORD@\n", &password)
}

fn escaped(path: &Path) -> String {
    let text = path.display().to_string().replace('%', "%%");
    if text.contains([' ', '"', '\\', '\'']) {
        format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
    } else {
        text
    }
}

const TEMPLATE: &str = include_str!("spykee.service");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_placeholders_of_the_unit_are_filled() {
        let of = Unit {
            program: Path::new("/opt/my robot/spykee"),
            config: Path::new("/etc/spykee/100%.yaml"),
            password: Some(Path::new("/etc/spykee/password")),
            user: None,
        };
        let text = unit(&of);
        assert!(
            text.contains(
                "ExecStart=\"/opt/my robot/spykee\" serve --config /etc/spykee/100%%.yaml"
            )
        );
        assert!(text.contains("LoadCredential=password:/etc/spykee/password\n"));
        assert!(text.contains("DynamicUser=yes\nUser=spykee\n"));
        assert!(!text.contains("@PROGRAM@") && !text.contains("@CONFIG@"));
        let without = unit(&Unit {
            password: None,
            user: Some("rover"),
            ..of
        });
        assert!(!without.contains("LoadCredential") && !without.contains("@PASSWORD@"));
        assert!(without.contains("\nUser=rover\n") && !without.contains("DynamicUser"));
        assert!(!without.contains("@USER@"));
    }
}
