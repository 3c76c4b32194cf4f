use super::*;
use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};

#[test]
fn only_regular_files_of_bounded_length_are_read() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name);
    fs::write(path("file"), "12345").unwrap();
    assert_eq!(read(&path("file"), 5).unwrap(), b"12345");
    assert!(matches!(
        read(&path("file"), 4),
        Err(ReadError::TooLong { most: 4 })
    ));
    let mode = Mode::RUSR | Mode::WUSR;
    rustix::fs::mknodat(CWD, path("pipe"), FileType::Fifo, mode, 0).unwrap();
    for (name, what) in [
        (path("pipe"), "a pipe"),
        (root.path().to_owned(), "a folder"),
        ("/dev/zero".into(), "a device"),
    ] {
        let error = read(&name, 100).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
    fs::write(path("bytes"), [0xff]).unwrap();
    assert!(matches!(
        read_text(&path("bytes"), 5),
        Err(ReadError::NoText)
    ));
}

#[test]
fn a_private_file_is_accessible_to_its_owner_only_and_not_a_link() {
    let root = tempfile::tempdir().unwrap();
    let (file, link) = (root.path().join("secret"), root.path().join("link"));
    fs::write(&file, "x").unwrap();
    symlink(&file, &link).unwrap();
    let allow = |mode| fs::set_permissions(&file, fs::Permissions::from_mode(mode)).unwrap();
    for mode in [0o640, 0o604, 0o620, 0o610] {
        allow(mode);
        assert!(is_shared(&file));
        assert!(read_private(&file, 10).is_err(), "{mode:o}");
    }
    allow(0o600);
    assert!(!is_shared(&file));
    assert_eq!(read_private(&file, 10).unwrap(), b"x");
    assert!(read_private(&link, 10).is_err());
}

#[test]
fn a_link_is_followed_only_where_that_is_asked_for() {
    let root = tempfile::tempdir().unwrap();
    let (file, link) = (root.path().join("file"), root.path().join("link"));
    fs::write(&file, "12345").unwrap();
    symlink(&file, &link).unwrap();
    assert_eq!(read_beginning(&link, 3).unwrap(), b"123");
    assert_eq!(read_beginning_unlinked(&file, 3).unwrap(), b"123");
    let error = read_beginning_unlinked(&link, 3).unwrap_err();
    assert_eq!(error.to_string(), "it is a symbolic link, not a file");
}

#[test]
fn a_folder_that_is_a_link_is_refused_and_links_in_it_are_not_followed() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name);
    fs::create_dir(path("elsewhere")).unwrap();
    symlink(path("elsewhere"), path("data")).unwrap();
    for opened in [Folder::open(&path("data")), Folder::make(&path("data"))] {
        let error = opened.unwrap_err().to_string();
        assert!(error.contains("symbolic link"), "{error}");
    }
    let folder = Folder::make(&path("deep/er")).unwrap();
    fs::write(path("secret"), "secret").unwrap();
    symlink(path("secret"), path("deep/er/a.jpg")).unwrap();
    assert!(folder.read("a.jpg", 100).is_err());
    assert_eq!(folder.items().unwrap(), []);
    folder.replace("a.jpg", b"new").unwrap();
    assert_eq!(fs::read(path("secret")).unwrap(), b"secret");
    assert_eq!(folder.read("a.jpg", 100).unwrap().unwrap(), b"new");
    // Also under the temporary name of an unfinished file.
    symlink(path("secret"), path("deep/er/.unfinished-b.jpg")).unwrap();
    folder.replace_durably("b.jpg", b"new").unwrap();
    assert_eq!(fs::read(path("secret")).unwrap(), b"secret");
    assert_eq!(folder.read("none", 100).unwrap(), None);
    let mode = |name: &str| fs::metadata(path(name)).unwrap().permissions().mode() & 0o777;
    assert_eq!((mode("deep/er"), mode("deep/er/b.jpg")), (0o700, 0o600));
}

#[test]
fn only_a_missing_file_is_created() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name);
    let folder = Folder::open(root.path()).unwrap();
    folder.create("a").unwrap();
    assert_eq!(fs::read(path("a")).unwrap(), b"");
    let mode = fs::metadata(path("a")).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    fs::write(path("a"), "kept").unwrap();
    folder.create("a").unwrap();
    assert_eq!(fs::read(path("a")).unwrap(), b"kept");
    symlink(path("none"), path("link")).unwrap();
    folder.create("link").unwrap();
    assert!(is_link(&path("link")) && !path("none").exists());
}

#[test]
fn unfinished_files_are_removed() {
    let root = tempfile::tempdir().unwrap();
    let folder = Folder::open(root.path()).unwrap();
    fs::write(root.path().join(".unfinished-a"), "x").unwrap();
    fs::write(root.path().join(".store-7"), "x").unwrap();
    folder.replace("b", b"12").unwrap();
    folder.sweep(".store-").unwrap();
    let names: Vec<_> = folder
        .items()
        .unwrap()
        .into_iter()
        .map(|item| (item.name, item.bytes))
        .collect();
    assert_eq!(names, [("b".to_owned(), 2)]);
    assert!(folder.free().unwrap() > 0);
}
