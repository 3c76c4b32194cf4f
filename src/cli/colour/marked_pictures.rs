//! Writes marked pictures: to one PNG file, or to a folder with one file per picture.

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::{MAIN_SEPARATOR, Path, PathBuf};

use image::{ImageFormat, RgbImage};

use crate::cli::Failure;

const HELP: &str =
    "for one picture, --annotate names a file that ends in .png; for several, a folder";

#[derive(Debug)]
pub(super) enum MarkedPictures {
    File(PathBuf),
    /// A folder, and the names already used in it.
    Folder(PathBuf, BTreeSet<String>),
}

impl MarkedPictures {
    pub(super) fn open(out: &Path, images: &[PathBuf]) -> Result<MarkedPictures, Failure> {
        let is_png = out
            .extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
        let shown = out.display();
        let ends_as_folder = shown.to_string().ends_with(MAIN_SEPARATOR);
        if out.is_dir() || ends_as_folder || images.len() > 1 {
            if is_png && !out.is_dir() || out.is_file() {
                let what = format_args!("{shown} is not a folder, but there are several pictures");
                return Err(Failure::usage(what).help(HELP));
            }
            return MarkedPictures::folder(out);
        }
        if !is_png {
            return Err(Failure::usage(format_args!("{shown} does not end in .png")).help(HELP));
        }
        let is_input = |image: &PathBuf| same_file(image, out);
        if images.iter().any(is_input) {
            let what = format_args!("{shown} is the picture itself and would be overwritten");
            return Err(Failure::usage(what).help("choose another name for --annotate"));
        }
        Ok(MarkedPictures::File(out.to_owned()))
    }

    fn folder(out: &Path) -> Result<MarkedPictures, Failure> {
        std::fs::create_dir_all(out).map_err(|error| {
            Failure::io(format_args!("create the folder {}", out.display()), error)
        })?;
        Ok(MarkedPictures::Folder(out.to_owned(), BTreeSet::new()))
    }

    pub(super) fn save(&mut self, image: &Path, marked: &RgbImage) -> Result<(), Failure> {
        let path = match self {
            MarkedPictures::File(path) => path.clone(),
            MarkedPictures::Folder(folder, taken) => folder.join(name(image, taken)),
        };
        let cannot = |error: String| Failure::unwritable(&path, error);
        let mut png = Cursor::new(Vec::new());
        marked
            .write_to(&mut png, ImageFormat::Png)
            .map_err(|error| cannot(error.to_string()))?;
        std::fs::write(&path, png.into_inner()).map_err(|error| cannot(error.to_string()))
    }
}

fn same_file(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}

/// The file name `NAME-blobs.png`, with a number if pictures in different folders have the same
/// name.
fn name(image: &Path, taken: &mut BTreeSet<String>) -> String {
    let stem = image
        .file_stem()
        .map_or_else(|| "picture".into(), |stem| stem.to_string_lossy());
    let mut name = format!("{stem}-blobs.png");
    for number in 2.. {
        if taken.insert(name.clone()) {
            break;
        }
        name = format!("{stem}-{number}-blobs.png");
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_with_the_same_name_do_not_overwrite_each_other() {
        let mut taken = BTreeSet::new();
        let mut names = ["a/shot.jpg", "b/shot.jpg", "c/shot.jpg", "c/.."]
            .map(|image| name(Path::new(image), &mut taken));
        assert_eq!(names[..2], ["shot-blobs.png", "shot-2-blobs.png"]);
        names.sort_unstable();
        assert!(names.windows(2).all(|pair| pair[0] != pair[1]), "{names:?}");
    }

    #[test]
    fn several_pictures_need_a_folder_and_one_a_png() {
        let folder = tempfile::tempdir().unwrap();
        let out = |name: &str| folder.path().join(name);
        let images = ["a.jpg", "b.jpg"].map(PathBuf::from);
        let refused = |out: PathBuf, images: &[PathBuf]| {
            let report = MarkedPictures::open(&out, images).unwrap_err().report();
            assert!(report.contains("--annotate"), "{report}");
        };
        refused(out("out.png"), &images);
        refused(out("out.jpg"), &images[..1]);
        refused(out("out"), &images[..1]);
        assert!(matches!(
            MarkedPictures::open(&out("out.PNG"), &images[..1]),
            Ok(MarkedPictures::File(_))
        ));
        assert!(matches!(
            MarkedPictures::open(&out("new"), &images),
            Ok(MarkedPictures::Folder(..))
        ));
        assert!(matches!(
            MarkedPictures::open(&out("new"), &images[..1]),
            Ok(MarkedPictures::Folder(..))
        ));
        std::fs::write(out("taken"), "").unwrap();
        refused(out("taken"), &images);
    }

    #[test]
    fn a_picture_is_never_overwritten_by_its_copy() {
        let folder = tempfile::tempdir().unwrap();
        let picture = folder.path().join("shot.png");
        std::fs::write(&picture, "picture").unwrap();
        let failure = MarkedPictures::open(&picture, std::slice::from_ref(&picture)).unwrap_err();
        let said = failure.to_string();
        assert!(said.contains("would be overwritten"), "{said}");
    }
}
