//! Evaluates lines that a person types, in a VM that is kept between them.
//!
//! Each line is a task like any other, under the same limits. All lines share the ownership of
//! their setpoint, so that the robot keeps moving while the person types the next one.

use mlua::prelude::{Lua, LuaError, LuaFunction, LuaMultiValue, LuaTable, LuaValue};

use super::arguments::describe;
use super::failure::{VmError, printable};
use super::output::Evaluated;
use super::sandbox;

const MAX_ENTRIES: usize = 16;
const MAX_VALUES: usize = 16;
const MAX_TEXT: usize = 200;

/// Compiles the text as an expression if it is one, else as statements. A variable that it declares
/// with `local` at its beginning lives on, as one of the session.
pub(super) fn compile(
    lua: &Lua,
    text: &str,
    chunk: &str,
    more: bool,
) -> Result<LuaFunction, Evaluated> {
    let text = sandbox::check_source(text.as_bytes(), chunk)
        .map_err(|failure| Evaluated::Failed(failure.to_string()))?;
    let first = match sandbox::compile(lua, &format!("return {text}"), chunk) {
        Ok(expression) => return Ok(expression),
        Err(error) => error,
    };
    if text.trim_start().starts_with("local ") {
        // Spaces, so that lines and columns of messages stay what they are.
        let set = text.replacen("local ", "      ", 1);
        if let Ok(statements) = sandbox::compile(lua, &set, chunk) {
            return Ok(statements);
        }
    }
    let second = match sandbox::compile(lua, text, chunk) {
        Ok(statements) => return Ok(statements),
        Err(error) => error,
    };
    // `1 +` is not a valid statement, but it is the beginning of an expression.
    let begins_one = is_incomplete(&first);
    if more && (begins_one || is_incomplete(&second)) {
        return Err(Evaluated::Incomplete);
    }
    Err(refused(if begins_one { &first } else { &second }))
}

fn is_incomplete(error: &LuaError) -> bool {
    matches!(
        error,
        LuaError::SyntaxError {
            incomplete_input: true,
            ..
        }
    )
}

pub(super) fn refused(error: &LuaError) -> Evaluated {
    Evaluated::Failed(VmError::from_lua(error).text_or("not enough memory for this line"))
}

/// Formats values for people: shallow, bounded, and without running code of the script.
pub(super) fn shown(values: &LuaMultiValue) -> Vec<String> {
    let mut texts: Vec<String> = values.iter().take(MAX_VALUES).map(show).collect();
    if values.len() > MAX_VALUES {
        texts.push(format!("… and {} more", values.len() - MAX_VALUES));
    }
    texts
}

fn show(value: &LuaValue) -> String {
    match value {
        LuaValue::Table(table) => show_table(table),
        other => show_inner(other),
    }
}

/// Formats a value inside a table; nested tables are not expanded.
fn show_inner(value: &LuaValue) -> String {
    match value {
        LuaValue::Nil => "nil".to_owned(),
        LuaValue::Table(_) => "{…}".to_owned(),
        LuaValue::String(text) => quote(&text.as_bytes()),
        LuaValue::Function(_) => "function".to_owned(),
        LuaValue::Vector(vector) => vector.to_string(),
        other => describe(other),
    }
}

/// Quotes a string. Only the beginning is converted, however long it is.
fn quote(bytes: &[u8]) -> String {
    let start = &bytes[..bytes.len().min(4 * MAX_TEXT)];
    let text = printable(&String::from_utf8_lossy(start), MAX_TEXT);
    let text = text.replace('\\', "\\\\").replace('"', "\\\"");
    format!("\"{}\"", text.replace('\n', "\\n").replace('\t', "\\t"))
}

fn show_table(table: &LuaTable) -> String {
    let mut entries = Vec::new();
    let mut next = 1_i64;
    for pair in table.pairs::<LuaValue, LuaValue>() {
        let Ok((key, value)) = pair else { break };
        if entries.len() == MAX_ENTRIES {
            entries.push("…".to_owned());
            break;
        }
        let value = show_inner(&value);
        let is_next = key.as_i64() == Some(next);
        next += i64::from(is_next);
        entries.push(match (is_next, name(&key)) {
            (true, _) => value,
            (false, Some(name)) => format!("{name} = {value}"),
            (false, None) => format!("[{}] = {value}", show_inner(&key)),
        });
    }
    format!("{{{}}}", entries.join(", "))
}

/// The key as a name, if it can be written without brackets.
fn name(key: &LuaValue) -> Option<String> {
    let text = key.as_string()?.to_str().ok()?.to_owned();
    let word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let is_name = text.len() <= MAX_TEXT
        && text.chars().all(word)
        && text.starts_with(|c: char| !c.is_ascii_digit());
    is_name.then_some(text)
}
