//! Writes the results as JUnit XML, for continuous integration.

use std::io;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};

use super::super::Failure;
use super::report::{Report, Run};
use crate::sanitize;

/// The report as a JUnit document.
///
/// # Errors
/// None is known, as the document is written to memory.
pub(super) fn document(report: &Report) -> Result<Vec<u8>, Failure> {
    write(report).map_err(|error| Failure::io("create the JUnit report", error))
}

fn write(report: &Report) -> io::Result<Vec<u8>> {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    xml.create_element("testsuites")
        .with_attribute(("name", "spykee test"))
        .write_inner_content(|xml| {
            for (file, broken, runs) in report.files() {
                write_file(xml, file, broken, &runs)?;
            }
            Ok(())
        })?;
    let mut bytes = xml.into_inner();
    bytes.push(b'\n');
    Ok(bytes)
}

fn write_file(
    xml: &mut Writer<Vec<u8>>,
    file: &str,
    broken: Option<&str>,
    runs: &[&Run],
) -> io::Result<()> {
    let failed = runs.iter().filter(|run| run.failure().is_some()).count();
    let tests = (runs.len() + usize::from(broken.is_some())).to_string();
    let seconds: f64 = runs.iter().map(|run| run.took().as_secs_f64()).sum();
    xml.create_element("testsuite")
        .with_attribute(("name", sanitize::xml(file).as_str()))
        .with_attribute(("tests", tests.as_str()))
        .with_attribute(("failures", failed.to_string().as_str()))
        .with_attribute(("errors", usize::from(broken.is_some()).to_string().as_str()))
        .with_attribute(("time", format!("{seconds:.3}").as_str()))
        .write_inner_content(|xml| {
            if let Some(broken) = broken {
                write_case(xml, file, "the file", 0.0, Some(("error", broken, broken)))?;
            }
            for run in runs {
                let words = run.describe();
                let failure = run.failure();
                let failure = failure.map(|one| ("failure", one.message.as_str(), words.as_str()));
                let name = format!("{} (seed {})", run.scenario, run.seed);
                write_case(xml, file, &name, run.took().as_secs_f64(), failure)?;
            }
            Ok(())
        })?;
    Ok(())
}

/// Writes a test case; `wrong` is the element of a failure, its message and its full text.
fn write_case(
    xml: &mut Writer<Vec<u8>>,
    file: &str,
    name: &str,
    seconds: f64,
    wrong: Option<(&str, &str, &str)>,
) -> io::Result<()> {
    let time = format!("{seconds:.3}");
    let case = xml
        .create_element("testcase")
        .with_attribute(("classname", sanitize::xml(file).as_str()))
        .with_attribute(("name", sanitize::xml(name).as_str()))
        .with_attribute(("time", time.as_str()));
    match wrong {
        None => case.write_empty()?,
        Some((element, message, story)) => case.write_inner_content(|xml| {
            xml.create_element(element)
                .with_attribute(("message", sanitize::xml(message).as_str()))
                .write_text_content(BytesText::new(&sanitize::xml(story)))?;
            Ok(())
        })?,
    };
    Ok(())
}
