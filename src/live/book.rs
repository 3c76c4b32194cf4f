//! The book at `/book/`: the pages that `scripts/book` has built, where they are installed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use axum::Router;
use axum::http::{StatusCode, Uri, header};
use axum::response::{IntoResponse, Redirect, Response};
use axum::routing::get;

use crate::files;

/// Where the pages are, seen from the program's folder: in a package, or in a checkout.
const PLACES: [&str; 2] = ["../share/spykee/book", "../book"];
const MAX_LEN: u64 = 16 << 20;
const MISSING: &str = "The book is not installed here. In a checkout, scripts/book builds it; \
                       as plain text it is in behaviours/guide/.\n";

/// The first of these folders, seen from the program's, that has this file.
pub fn installed(places: [&str; 2], file: &str) -> Option<PathBuf> {
    let program = std::env::current_exe().unwrap_or_default();
    let folder = program.parent().unwrap_or(Path::new("/"));
    let mut places = places.iter().map(|place| folder.join(place));
    places.find(|place| place.join(file).is_file())
}

/// The files of the book by their paths below `/book/`. A request can name nothing else.
#[derive(Debug, Default)]
struct Book {
    files: BTreeMap<String, PathBuf>,
}

impl Book {
    /// The installed book; without files if there is none.
    fn installed() -> Book {
        installed(PLACES, "index.html").map_or_else(Book::default, |place| Book::read(&place))
    }

    /// The files of a folder. Symbolic links are not followed.
    fn read(folder: &Path) -> Book {
        let mut book = Book::default();
        book.add(folder, "");
        book
    }

    fn add(&mut self, folder: &Path, prefix: &str) {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let Ok(name) = entry.file_name().into_string() else {
                continue;
            };
            let path = format!("{prefix}{name}");
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => self.add(&entry.path(), &format!("{path}/")),
                Ok(kind) if kind.is_file() => {
                    self.files.insert(path, entry.path());
                }
                _ => {}
            }
        }
    }

    async fn serve(self: Arc<Book>, uri: Uri) -> Response {
        let path = uri.path().strip_prefix("/book/").unwrap_or_default();
        let name = if path.is_empty() { "index.html" } else { path };
        if self.files.is_empty() {
            return (StatusCode::NOT_FOUND, MISSING).into_response();
        }
        let Some(file) = self.files.get(name).cloned() else {
            return (StatusCode::NOT_FOUND, "The book has no such page.\n").into_response();
        };
        let headers = [
            (header::CONTENT_TYPE, content_type(name)),
            (header::CACHE_CONTROL, "no-cache"),
        ];
        match tokio::task::spawn_blocking(move || files::read(&file, MAX_LEN)).await {
            Ok(Ok(bytes)) => (headers, bytes).into_response(),
            _ => (StatusCode::NOT_FOUND, "This page cannot be read.\n").into_response(),
        }
    }
}

fn content_type(name: &str) -> &'static str {
    match name.rsplit('.').next().unwrap_or_default() {
        "html" => "text/html; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "json" => "application/json",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "jpg" => "image/jpeg",
        "woff2" => "font/woff2",
        _ => "application/octet-stream",
    }
}

pub(super) fn routes() -> Router {
    let book = Arc::new(Book::installed());
    let serve = get(move |uri: Uri| book.clone().serve(uri));
    Router::new()
        .route("/book", get(|| async { Redirect::permanent("/book/") }))
        .route("/book/", serve.clone())
        .route("/book/{*path}", serve)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_files_of_the_book_have_a_path() {
        let outside = tempfile::tempdir().unwrap();
        let folder = outside.path().join("book");
        std::fs::create_dir_all(folder.join("learn")).unwrap();
        std::fs::write(outside.path().join("secret"), "").unwrap();
        std::fs::write(folder.join("index.html"), "").unwrap();
        std::fs::write(folder.join("learn/01.html"), "").unwrap();
        std::os::unix::fs::symlink(outside.path(), folder.join("link")).unwrap();
        std::os::unix::fs::symlink("../secret", folder.join("secret")).unwrap();
        let book = Book::read(&folder);
        let names: Vec<&str> = book.files.keys().map(String::as_str).collect();
        assert_eq!(names, ["index.html", "learn/01.html"]);
    }
}
