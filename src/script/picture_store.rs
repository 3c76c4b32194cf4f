//! The data folder with the pictures that a script saves. Names cannot refer to files outside the
//! folder, symbolic links in it are not followed, and its size is bounded: the oldest pictures are
//! deleted to make room for new ones.

use std::collections::VecDeque;
use std::io;
use std::path::PathBuf;
use std::time::Duration;

use tokio::time::Instant;

use super::options::Limits;
use crate::files::{Folder, Item};
use crate::rate_limit::{Repeats, TokenBucket};

/// The size that every file counts as at least, in bytes, so that the number of tiny files is
/// limited too.
const LEAST: u64 = 4096;
/// How often deleted and refused pictures are reported.
const MESSAGE_INTERVAL: Duration = Duration::from_secs(3600);

#[derive(Debug)]
pub(super) enum NotSaved {
    /// A limit is reached; the message, once an hour.
    Quota(Option<String>),
    Io(io::Error),
}

impl From<io::Error> for NotSaved {
    fn from(error: io::Error) -> NotSaved {
        NotSaved::Io(error)
    }
}

#[derive(Debug)]
pub(super) struct Saved {
    pub(super) path: PathBuf,
    /// A message about the pictures that were deleted for it, once an hour.
    pub(super) notice: Option<String>,
}

#[derive(Debug)]
pub(super) struct PictureStore {
    folder: Option<PathBuf>,
    quota: u64,
    free: u64,
    day: TokenBucket,
    /// The content of the folder, once it was read.
    content: Option<FolderContent>,
    /// By the words that name a kind of message.
    messages: Repeats<&'static str>,
}

#[derive(Debug, Default)]
struct FolderContent {
    /// Oldest first.
    pictures: VecDeque<Item>,
    weight: u64,
}

impl FolderContent {
    fn read(folder: &Folder) -> io::Result<FolderContent> {
        let mut items = folder.items()?;
        items.sort();
        let weight = items.iter().map(|item| weight(item.bytes)).sum();
        items.retain(|item| is_picture(&item.name));
        let pictures = items.into();
        Ok(FolderContent { pictures, weight })
    }

    fn forget(&mut self, name: &str) {
        if let Some(at) = self.pictures.iter().position(|item| item.name == name)
            && let Some(item) = self.pictures.remove(at)
        {
            self.weight = self.weight.saturating_sub(weight(item.bytes));
        }
    }
}

impl PictureStore {
    /// Creates the store. With no folder, nothing can be saved.
    pub(super) fn new(folder: Option<PathBuf>, limits: &Limits) -> PictureStore {
        PictureStore {
            folder,
            quota: limits.picture_bytes,
            free: limits.free_bytes,
            day: TokenBucket::a_day(limits.bytes_a_day),
            content: None,
            messages: Repeats::new(MESSAGE_INTERVAL),
        }
    }

    /// Of the day's bytes, only so many may be saved at once now.
    pub(super) fn with_left(mut self, left: Option<u64>) -> PictureStore {
        self.day = self.day.with_left(left);
        self
    }

    /// Saves a picture, replacing one of the same name; deletes the oldest pictures if needed.
    pub(super) fn save(
        &mut self,
        name: &str,
        bytes: &[u8],
        now: Instant,
    ) -> Result<Saved, NotSaved> {
        let Some(path) = self.folder.clone() else {
            return Err(io::Error::other("there is no data folder").into());
        };
        let folder = Folder::make(&path)?;
        let heavy = weight(bytes.len() as u64);
        if heavy > self.quota {
            let why = format!(
                "it is larger than the limit of {} bytes for all pictures",
                self.quota
            );
            return Err(self.refuse("too large", &why, now));
        }
        if folder
            .free()
            .is_ok_and(|free| free < self.free.saturating_add(heavy))
        {
            let why = format!("the disk has less than {} bytes left", self.free);
            return Err(self.refuse("disk", &why, now));
        }
        if !self.day.take(heavy as f64, now) {
            let why = format!(
                "the limit of {} bytes of pictures a day is used up",
                self.day.per_day()
            );
            return Err(self.refuse("day", &why, now));
        }
        let deleted = self.make_room(&folder, name, heavy)?;
        folder.replace(name, bytes)?;
        self.keep(&folder, name)?;
        let notice = match deleted {
            0 => None,
            deleted => self.removal_notice(deleted, now),
        };
        Ok(Saved {
            path: path.join(name),
            notice,
        })
    }

    /// Deletes the oldest pictures until there is room; returns how many.
    fn make_room(&mut self, folder: &Folder, name: &str, heavy: u64) -> io::Result<u64> {
        let mut content = match self.content.take() {
            Some(content) => content,
            None => FolderContent::read(folder)?,
        };
        content.forget(name);
        let mut deleted = 0;
        while content.weight + heavy > self.quota {
            let Some(oldest) = content.pictures.front().map(|item| item.name.clone()) else {
                break;
            };
            match folder.remove(&oldest) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => content.forget(&oldest),
            }
            deleted += 1;
        }
        self.content = Some(content);
        Ok(deleted)
    }

    fn keep(&mut self, folder: &Folder, name: &str) -> io::Result<()> {
        let (Some(item), Some(content)) = (folder.item(name)?, &mut self.content) else {
            return Ok(());
        };
        content.weight += weight(item.bytes);
        content.pictures.push_back(item);
        Ok(())
    }

    fn refuse(&mut self, kind: &'static str, why: &str, now: Instant) -> NotSaved {
        let words = self.messages.record(kind, now).map(|before| match before {
            0 => format!("a picture was not saved: {why}"),
            before => format!("a picture was not saved, nor were {before} before it: {why}"),
        });
        NotSaved::Quota(words)
    }

    fn removal_notice(&mut self, deleted: u64, now: Instant) -> Option<String> {
        let before = self.messages.record("deleted", now)?;
        let quota = self.quota;
        Some(format!(
            "the pictures have reached {quota} bytes: {} of the oldest deleted since the last such \
             message",
            before + deleted
        ))
    }
}

fn is_picture(name: &str) -> bool {
    !name.starts_with('.') && name.to_ascii_lowercase().ends_with(".jpg")
}

/// The rule for names of pictures, as a message.
pub(crate) const NAMES: &str =
    "the name may have letters, digits, '-', '_' and '.', and must not begin with '.' or '-'";

/// Returns the name of the file, with `.jpg` appended unless it ends so already. `None` if the name
/// could refer to a file outside the folder, or could cause trouble in a shell.
pub(crate) fn file_name(name: &str) -> Option<String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if name.is_empty() || name.starts_with(['.', '-']) || !name.chars().all(plain) {
        return None;
    }
    let has_ending = name.to_ascii_lowercase().ends_with(".jpg");
    Some(if has_ending {
        name.to_owned()
    } else {
        format!("{name}.jpg")
    })
}

fn weight(bytes: u64) -> u64 {
    bytes.max(LEAST)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    use std::path::Path;

    use super::*;

    fn limits(pictures: u64) -> Limits {
        Limits {
            picture_bytes: pictures * LEAST,
            bytes_a_day: 1 << 40,
            free_bytes: 0,
            ..Limits::default()
        }
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn names_cannot_leave_the_folder() {
        assert_eq!(file_name("ball").as_deref(), Some("ball.jpg"));
        assert_eq!(file_name("ball-1.JPG").as_deref(), Some("ball-1.JPG"));
        for name in [
            "", ".", "..", "../x", "a/b", "a\\b", "-x", ".x", "a b", "ä", "a\0",
        ] {
            assert_eq!(file_name(name), None, "{name:?}");
        }
    }

    #[test]
    fn the_oldest_pictures_are_deleted_and_the_folder_is_private() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("data");
        let mut store = PictureStore::new(Some(folder.clone()), &limits(3));
        let now = Instant::now();
        for name in ["a.jpg", "b.jpg", "a.jpg", "c.jpg"] {
            assert!(store.save(name, &[1, 2, 3], now).unwrap().notice.is_none());
        }
        let notice = store.save("d.jpg", &[1], now).unwrap().notice.unwrap();
        assert!(notice.contains("1 of the oldest deleted"), "{notice}");
        assert_eq!(names(&folder), ["a.jpg", "c.jpg", "d.jpg"]);
        assert!(store.save("e.jpg", &[1], now).unwrap().notice.is_none());
        // Files that are not pictures stay, and count.
        fs::write(folder.join("store.json"), "{}").unwrap();
        let mut again = PictureStore::new(Some(folder.clone()), &limits(3));
        let path = again.save("f.jpg", &[9], now).unwrap().path;
        assert_eq!(names(&folder), ["e.jpg", "f.jpg", "store.json"]);
        assert_eq!(fs::read(&path).unwrap(), [9]);
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!((mode(&path), mode(&folder)), (0o600, 0o700));
    }

    #[test]
    fn the_limits_of_the_day_the_disk_and_the_folder_are_kept() {
        let root = tempfile::tempdir().unwrap();
        let folder = Some(root.path().to_owned());
        let mut now = Instant::now();
        let day = Limits {
            bytes_a_day: 48 * LEAST,
            ..limits(100)
        };
        let mut store = PictureStore::new(folder.clone(), &day);
        let mut save = |now| store.save("a.jpg", &[1], now);
        assert!(save(now).is_ok() && save(now).is_ok());
        let refused = save(now);
        assert!(
            matches!(&refused, Err(NotSaved::Quota(Some(why))) if why.contains("a day")),
            "{refused:?}"
        );
        assert!(matches!(save(now), Err(NotSaved::Quota(None))));
        now += MESSAGE_INTERVAL;
        assert!(save(now).is_ok());
        assert!(
            matches!(save(now), Err(NotSaved::Quota(Some(why))) if why.contains("nor were 1 before"))
        );
        let floor = Limits {
            free_bytes: u64::MAX,
            ..limits(100)
        };
        let refused = PictureStore::new(folder.clone(), &floor).save("a.jpg", &[1], now);
        assert!(matches!(refused, Err(NotSaved::Quota(Some(why))) if why.contains("disk")));
        let large = PictureStore::new(folder, &limits(1)).save("a.jpg", &[1; 5000], now);
        assert!(matches!(large, Err(NotSaved::Quota(Some(why))) if why.contains("larger")));
    }

    #[test]
    fn a_link_is_replaced_and_not_followed() {
        let root = tempfile::tempdir().unwrap();
        let path = |name: &str| root.path().join(name);
        fs::write(path("secret"), "secret").unwrap();
        fs::create_dir(path("data")).unwrap();
        symlink(path("secret"), path("data/a.jpg")).unwrap();
        let mut store = PictureStore::new(Some(path("data")), &limits(10));
        store.save("a.jpg", &[1], Instant::now()).unwrap();
        assert_eq!(fs::read(path("secret")).unwrap(), b"secret");
        symlink(path("data"), path("other")).unwrap();
        let saved =
            PictureStore::new(Some(path("other")), &limits(10)).save("b.jpg", &[1], Instant::now());
        assert!(matches!(saved, Err(NotSaved::Io(_))));
    }

    #[test]
    fn without_a_folder_nothing_is_saved() {
        let result = PictureStore::new(None, &limits(10)).save("a.jpg", &[1], Instant::now());
        assert!(matches!(result, Err(NotSaved::Io(_))));
    }
}
