//! The files of the page, embedded in the program.

use axum::Router;
use axum::http::header;
use axum::routing::get;

/// Path, content type, content.
const FILES: &[(&str, &str, &str)] = &[
    (
        "/",
        "text/html; charset=utf-8",
        include_str!("page/index.html"),
    ),
    (
        "/style.css",
        "text/css; charset=utf-8",
        include_str!("page/style.css"),
    ),
    ("/icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
    ("/app.js", JS, include_str!("page/app.js")),
    ("/battery.js", JS, include_str!("page/battery.js")),
    ("/behaviours.js", JS, include_str!("page/behaviours.js")),
    ("/camera.js", JS, include_str!("page/camera.js")),
    ("/connection.js", JS, include_str!("page/connection.js")),
    ("/dom.js", JS, include_str!("page/dom.js")),
    ("/drive.js", JS, include_str!("page/drive.js")),
    ("/log.js", JS, include_str!("page/log.js")),
    ("/login.js", JS, include_str!("page/login.js")),
    ("/map.js", JS, include_str!("page/map.js")),
    ("/history.js", JS, include_str!("page/history.js")),
    ("/robot.js", JS, include_str!("page/robot.js")),
    ("/script.js", JS, include_str!("page/script.js")),
    ("/simulation.js", JS, include_str!("page/simulation.js")),
    ("/texts.js", JS, include_str!("page/texts.js")),
];
const JS: &str = "text/javascript; charset=utf-8";

/// Returns the routes of all files.
pub(super) fn routes() -> Router {
    FILES
        .iter()
        .fold(Router::new(), |router, &(path, kind, content)| {
            // Another version of the program has other files.
            let headers = [
                (header::CONTENT_TYPE, kind),
                (header::CACHE_CONTROL, "no-cache"),
            ];
            router.route(path, get(move || async move { (headers, content) }))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_no_external_resources_and_no_inline_code() {
        for (path, kind, content) in FILES {
            assert!(!content.contains("https://"), "{path}");
            assert!(
                !content.contains("innerHTML") && !content.contains("eval("),
                "{path}"
            );
            if kind.starts_with("text/html") {
                assert!(
                    !content.contains(" style=") && !content.contains(" onclick"),
                    "{path}"
                );
                assert_eq!(content.matches("<script").count(), 1, "{path}");
            }
        }
    }

    #[test]
    fn every_imported_module_exists() {
        for (path, _, content) in FILES.iter().filter(|file| file.1 == JS) {
            for line in content.lines().filter(|line| line.starts_with("import")) {
                let name = line
                    .rsplit('"')
                    .nth(1)
                    .unwrap_or_default()
                    .trim_start_matches('.');
                assert!(FILES.iter().any(|file| file.0 == name), "{path}: {line}");
            }
        }
    }
}
