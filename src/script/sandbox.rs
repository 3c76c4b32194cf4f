//! A VM with restrictions: allowed globals only, bounded memory, no library call that runs for long
//! without a safepoint, and an error for unknown names. Each item has a test in
//! `tests/it/hostile.rs`.

use std::sync::Once;

use mlua::chunk::{ChunkMode, Compiler};
use mlua::prelude::{Lua, LuaFunction, LuaLightUserData, LuaResult, LuaTable, LuaValue};
use mlua::state::{GcIncParams, GcMode};
use mlua::{LuaOptions, StdLib};

use super::failure::{Failure, PRELUDE, VmError, printable};
use super::interrupt;
use crate::api;
use crate::yaml::suggestion;

/// The largest source, in bytes: the compiler's time and memory are outside the VM's limits.
pub const MAX_SOURCE: usize = 256 * 1024;

/// The largest work of one pattern search: length of the text times length of the pattern.
const MAX_WORK: u32 = 1 << 24;

/// The memory that a script always has beyond what the runtime uses in its VM, in bytes, however
/// small its limit.
const LEAST_MEMORY: usize = 256 * 1024;

/// Globals of the standard libraries that are removed.
const REMOVED: [&str; 7] = [
    "loadstring",
    "require",
    "getfenv",
    "setfenv",
    "newproxy",
    "gcinfo",
    "print",
];

/// Checks a source as far as possible without compiling it; returns the text without its byte order
/// mark.
pub(crate) fn check_source<'a>(source: &'a [u8], chunk: &str) -> Result<&'a str, Failure> {
    let chunk = || chunk.to_owned();
    if source.len() > MAX_SOURCE {
        return Err(Failure::TooLarge {
            chunk: chunk(),
            bytes: source.len(),
        });
    }
    // A byte order mark of UTF-16, as Windows writes it: every other byte would be a control character.
    if source.starts_with(&[0xff, 0xfe]) || source.starts_with(&[0xfe, 0xff]) {
        return Err(Failure::NotUtf8 {
            chunk: chunk(),
            line: 1,
        });
    }
    let line_of = |at: usize| 1 + source[..at].iter().filter(|&&byte| byte == b'\n').count();
    if let Some(at) = source.iter().position(is_control) {
        return Err(Failure::Control {
            chunk: chunk(),
            line: line_of(at),
            byte: source[at],
        });
    }
    let text = std::str::from_utf8(source).map_err(|error| Failure::NotUtf8 {
        chunk: chunk(),
        line: line_of(error.valid_up_to()),
    })?;
    Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
}

fn is_control(byte: &u8) -> bool {
    byte.is_ascii_control() && !matches!(byte, b'\t' | b'\n' | b'\r')
}

pub(super) fn compile(lua: &Lua, source: &str, chunk: &str) -> LuaResult<LuaFunction> {
    lua.load(source)
        .set_name(format!("={chunk}"))
        .set_mode(ChunkMode::Text)
        .set_compiler(compiler())
        .into_function()
}

/// The compiler's error message for a checked source, if it does not compile.
pub(crate) fn compile_error(source: &str, chunk: &str) -> Option<String> {
    let compiled = open().and_then(|lua| compile(&lua, source, chunk).map(drop));
    let error = VmError::from_lua(&compiled.err()?);
    Some(error.text_or("not enough memory to compile it"))
}

/// Compiles a checked source as a module with its own globals.
pub(super) fn compile_module(
    lua: &Lua,
    source: &str,
    chunk: &str,
    globals: LuaTable,
) -> LuaResult<LuaFunction> {
    lua.load(source)
        .set_name(format!("={chunk}"))
        .set_mode(ChunkMode::Text)
        .set_compiler(compiler())
        .set_environment(globals)
        .into_function()
}

/// The compiler's options: no inlining, so that every stack frame has its line.
fn compiler() -> Compiler {
    Compiler::new().set_optimization_level(1).set_debug_level(1)
}

/// A marker that the scheduler and the prelude exchange; scripts cannot create this value.
pub(super) fn mark() -> LuaValue {
    static MARK: u8 = 0;
    LuaValue::LightUserData(LuaLightUserData(
        std::ptr::from_ref(&MARK).cast_mut().cast(),
    ))
}

/// Creates a VM with the libraries that a script may use, not yet closed.
pub(super) fn open() -> LuaResult<Lua> {
    set_flags();
    let libraries = StdLib::COROUTINE
        | StdLib::TABLE
        | StdLib::STRING
        | StdLib::UTF8
        | StdLib::BIT
        | StdLib::MATH
        | StdLib::BUFFER
        | StdLib::VECTOR;
    let lua = Lua::new_with(libraries, LuaOptions::new())?;
    for name in REMOVED {
        lua.globals().raw_set(name, LuaValue::Nil)?;
    }
    lua.gc_set_mode(GcMode::Incremental(collector()));
    interrupt::install(&lua)?;
    Ok(lua)
}

pub(super) fn seed(lua: &Lua, seed: u64) -> LuaResult<()> {
    let math: LuaTable = lua.globals().raw_get("math")?;
    // Luau takes 32 bits of seed.
    let folded = (seed ^ (seed >> 32)) as u32;
    math.raw_get::<LuaFunction>("randomseed")?
        .call(f64::from(i32::from_ne_bytes(folded.to_ne_bytes())))
}

/// The garbage collector works in large steps and begins early. With Luau's default values garbage
/// accumulates faster than it is collected and reaches the limit: a script that held 2 MiB and
/// created short-lived texts of 50 KB ran out of its 8 MiB. With these values a script may hold 6
/// MiB, at the same speed.
fn collector() -> GcIncParams {
    GcIncParams::default()
        .goal(110)
        .step_multiplier(800)
        .step_size(256)
}

/// Sets flags of the whole process, which must be done before its first VM is created.
fn set_flags() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // Without it `table.move` over 2·10⁹ places runs for many seconds. Versions of Luau without
        // the flag always have the fix; a test checks it.
        let _ = Lua::set_fflag("LuauTableMoveTimeoutFix", true);
    });
}

/// Runs the prelude, and installs its replacements of library functions. Returns its functions.
pub(super) fn run_prelude(lua: &Lua, place: LuaFunction) -> LuaResult<LuaTable> {
    let prelude = compile(lua, include_str!("stdlib/prelude.luau"), PRELUDE)?;
    let is_native =
        lua.create_function(|_, function: LuaFunction| Ok(function.info().what == "C"))?;
    let prelude: LuaTable = prelude.call((place, mark(), MAX_WORK, is_native))?;
    replace(lua, "coroutine", &prelude.raw_get("coroutines")?)?;
    replace(lua, "string", &prelude.raw_get("strings")?)?;
    replace(lua, "table", &prelude.raw_get("tables")?)?;
    Ok(prelude)
}

fn replace(lua: &Lua, library: &str, functions: &LuaTable) -> LuaResult<()> {
    let library: LuaTable = lua.globals().raw_get(library)?;
    functions.for_each(|name: LuaValue, function: LuaValue| library.raw_set(name, function))
}

/// Closes the VM: libraries and globals become read-only, unknown globals are errors, and memory is
/// limited from now on.
pub(super) fn close(lua: &Lua, strict: LuaFunction, memory: usize) -> LuaResult<()> {
    let strict_globals = lua.create_table()?;
    strict_globals.raw_set("__index", strict)?;
    lua.globals().set_metatable(Some(strict_globals))?;
    lua.sandbox(true)?;
    let own = lua.globals();
    if let Some(meta) = own.metatable() {
        meta.set_readonly(false);
        meta.raw_set("__metatable", false)?;
        meta.set_readonly(true);
    }
    own.raw_set("_G", own.clone())?;
    lua.set_memory_limit(memory.max(lua.used_memory() + LEAST_MEMORY))?;
    Ok(())
}

/// The message for a global, or a field of `owner`, that does not exist.
pub(super) fn unknown(owner: &str, key: &str, known: &[String]) -> String {
    let near = suggestion(key, known.iter().map(String::as_str));
    let key = printable(key, 40);
    if !owner.is_empty() {
        return format!("{owner}.{key} does not exist{near}");
    }
    let in_scenario = known.iter().any(|name| name == api::SCENARIO);
    match api::elsewhere(&key, in_scenario) {
        Some(elsewhere) => format!("unknown name '{key}'; {elsewhere}"),
        None => format!("unknown name '{key}'{near}"),
    }
}
