use super::*;
use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};

#[test]
fn the_last_content_is_written_at_the_end_and_is_private() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("data");
    let mut writer = StoreWriter::new(folder.clone(), &Limits::default());
    assert!(writer.read().unwrap().is_none());
    let now = Instant::now();
    for number in 0..20 {
        writer.offer(Some(format!("{number}").into_bytes()), now);
    }
    assert!(!writer.is_due(now) && writer.is_due(now + PACE));
    assert_eq!(writer.finish(None), None);
    assert_eq!(writer.read().unwrap().unwrap(), b"19");
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!((mode(&folder), mode(&folder.join(NAME))), (0o700, 0o600));
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
}

#[test]
fn in_virtual_time_it_is_written_once_however_the_host_ends() {
    let root = tempfile::tempdir().unwrap();
    let file = root.path().join(NAME);
    let mut writer = StoreWriter::at_the_end(root.path().to_owned(), &Limits::default());
    writer.offer(Some(b"one".to_vec()), Instant::now());
    writer.offer(Some(b"two".to_vec()), Instant::now());
    assert!(!file.exists() && !writer.is_behind());
    drop(writer);
    assert_eq!(fs::read(&file).unwrap(), b"two");
    let mut writer = StoreWriter::at_the_end(root.path().to_owned(), &Limits::default());
    writer.offer(Some(b"three".to_vec()), Instant::now());
    assert_eq!(writer.finish(None), None);
    assert_eq!(fs::read(&file).unwrap(), b"three");
    let mut writer = StoreWriter::at_the_end(root.path().to_owned(), &Limits::default());
    writer.offer(Some(b"four".to_vec()), Instant::now());
    assert_eq!(writer.finish(Some(b"five".to_vec())), None);
    drop(writer);
    assert_eq!(fs::read(&file).unwrap(), b"five");
}

#[test]
fn leftover_temporary_files_are_removed() {
    let root = tempfile::tempdir().unwrap();
    fs::write(root.path().join(".store-77"), "{\"a\": ").unwrap();
    fs::write(root.path().join(NAME), "{}").unwrap();
    let mut writer = StoreWriter::new(root.path().to_owned(), &Limits::default());
    assert_eq!(writer.read().unwrap().unwrap(), b"{}");
    assert_eq!(writer.finish(Some(b"new".to_vec())), None);
    assert_eq!(writer.read().unwrap().unwrap(), b"new");
    assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1);
}

#[test]
fn a_damaged_file_is_kept_aside() {
    let root = tempfile::tempdir().unwrap();
    fs::write(root.path().join(NAME), "{ torn").unwrap();
    let warning = StoreWriter::new(root.path().to_owned(), &Limits::default()).set_aside("torn");
    assert!(
        warning.contains("store.json.bad") && warning.contains("torn"),
        "{warning}"
    );
    assert_eq!(fs::read(root.path().join(BAD)).unwrap(), b"{ torn");
    assert!(!root.path().join(NAME).exists());
}

#[test]
fn a_symbolic_link_as_folder_or_file_is_not_followed() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name);
    fs::create_dir(path("elsewhere")).unwrap();
    fs::write(path("elsewhere/store.json"), "{}").unwrap();
    symlink(path("elsewhere"), path("data")).unwrap();
    let mut writer = StoreWriter::new(path("data"), &Limits::default());
    assert!(writer.read().is_err());
    assert!(
        writer
            .finish(Some(b"1".to_vec()))
            .unwrap()
            .contains("symbolic link")
    );
    assert_eq!(fs::read(path("elsewhere/store.json")).unwrap(), b"{}");
    fs::create_dir(path("own")).unwrap();
    symlink(path("elsewhere/store.json"), path("own/store.json")).unwrap();
    let mut writer = StoreWriter::new(path("own"), &Limits::default());
    assert!(writer.read().is_err());
    assert_eq!(writer.finish(Some(b"1".to_vec())), None);
    assert_eq!(fs::read(path("elsewhere/store.json")).unwrap(), b"{}");
    assert_eq!(fs::read(path("own/store.json")).unwrap(), b"1");
}

#[test]
fn a_store_over_its_daily_budget_is_written_once_a_minute() {
    let root = tempfile::tempdir().unwrap();
    let limits = Limits {
        store_bytes_a_day: 48,
        ..Limits::default()
    };
    let mut writer = StoreWriter::new(root.path().to_owned(), &limits);
    let now = Instant::now();
    writer.offer(Some(b"12".to_vec()), now);
    assert!(writer.is_due(now + PACE) && writer.take_error().is_none());
    writer.offer(Some(b"34".to_vec()), now + PACE);
    assert!(!writer.is_due(now + PACE + PACE) && writer.is_due(now + PACE + SLOW_PACE));
    assert!(writer.take_error().unwrap().contains("once per minute"));
    assert!(writer.take_error().is_none());
    assert_eq!(writer.finish(Some(b"56".to_vec())), None);
    assert_eq!(writer.read().unwrap().unwrap(), b"56");
}

#[test]
fn nothing_is_written_to_a_full_disk() {
    let root = tempfile::tempdir().unwrap();
    let limits = Limits {
        free_bytes: 1 << 50,
        ..Limits::default()
    };
    let mut writer = StoreWriter::new(root.path().to_owned(), &limits);
    let warning = writer.finish(Some(b"1".to_vec())).unwrap();
    assert!(warning.contains("disk"), "{warning}");
    assert!(!root.path().join(NAME).exists());
}

#[test]
fn a_thread_that_cannot_be_started_is_reported_and_tried_again() {
    let root = tempfile::tempdir().unwrap();
    let mut writer = StoreWriter::new(root.path().to_owned(), &Limits::default());
    writer.start = |_, _| Err(io::Error::other("no more threads"));
    let now = Instant::now();
    writer.offer(Some(b"1".to_vec()), now);
    let trouble = writer.take_error().unwrap();
    assert!(trouble.contains("no more threads"), "{trouble}");
    writer.offer(None, now + PACE);
    assert_eq!((writer.is_behind(), writer.take_error()), (true, None));
    writer.start = Writer::start;
    assert_eq!(writer.finish(None), None);
    assert_eq!(writer.read().unwrap().unwrap(), b"1");
    writer.start = |_, _| Err(io::Error::other("no more threads"));
    assert_eq!(writer.finish(Some(b"2".to_vec())), None);
    assert_eq!(writer.read().unwrap().unwrap(), b"2");
}

/// A writer whose writes fail as long as the returned folder exists.
fn obstructed(root: &Path) -> (StoreWriter, PathBuf) {
    let obstacle = root.join(".unfinished-store.json");
    fs::create_dir(&obstacle).unwrap();
    let writer = StoreWriter::new(root.to_owned(), &Limits::default());
    (writer, obstacle)
}

/// Waits until this is true.
fn wait_until(mut done: impl FnMut() -> bool) {
    for _ in 0..6000 {
        if done() {
            return;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("it did not happen within a minute");
}

#[test]
fn content_whose_write_failed_is_written_as_soon_as_that_is_possible() {
    let root = tempfile::tempdir().unwrap();
    let (mut writer, obstacle) = obstructed(root.path());
    let now = Instant::now();
    writer.offer(Some(b"1".to_vec()), now);
    wait_until(|| writer.take_error().is_some());
    assert!(writer.is_behind());
    fs::remove_dir(obstacle).unwrap();
    writer.offer(None, now + PACE);
    assert!(!writer.is_behind());
    wait_until(|| writer.read().unwrap().is_some());
    assert_eq!(writer.read().unwrap().unwrap(), b"1");
    assert_eq!((writer.take_error(), writer.finish(None)), (None, None));
}

#[test]
fn content_whose_write_failed_is_written_at_the_end() {
    let root = tempfile::tempdir().unwrap();
    let (mut writer, obstacle) = obstructed(root.path());
    writer.offer(Some(b"1".to_vec()), Instant::now());
    wait_until(|| writer.take_error().is_some());
    fs::remove_dir(obstacle).unwrap();
    assert_eq!(writer.finish(None), None);
    assert_eq!(writer.read().unwrap().unwrap(), b"1");
}

#[test]
fn content_whose_write_failed_never_replaces_newer_content() {
    let root = tempfile::tempdir().unwrap();
    let (mut writer, obstacle) = obstructed(root.path());
    let now = Instant::now();
    writer.offer(Some(b"1".to_vec()), now);
    writer.offer(Some(b"2".to_vec()), now + PACE);
    wait_until(|| writer.take_error().is_some());
    fs::remove_dir(obstacle).unwrap();
    assert_eq!(writer.finish(None), None);
    assert_eq!(writer.read().unwrap().unwrap(), b"2");
}

#[test]
fn a_folder_that_cannot_be_written_is_reported() {
    let root = tempfile::tempdir().unwrap();
    let file = root.path().join("file");
    fs::write(&file, "").unwrap();
    let mut writer = StoreWriter::new(file.join("data"), &Limits::default());
    assert!(writer.finish(Some(b"1".to_vec())).is_some());
}
