//! Colours as scripts write them: names, `vision.lab`, `vision.hsv`, the results of `vision.learn`,
//! and lists of these.

use mlua::UserDataMethods as _;
use mlua::prelude::{LuaResult, LuaTable, LuaValue};

use super::super::arguments::{Refusal, describe};
use super::super::nearest::suggestion;
use super::{Builder, Call, NativeResult};
use crate::vision::{Blob, Colour, MAX_COLOURS};

/// The script's object for a colour without a name.
pub(super) struct ColourObject(pub(super) Colour);

/// The colours of one search, with the names under which their blobs are reported.
#[derive(Debug, Clone, Default)]
pub(super) struct Colours {
    pub(super) colours: Vec<Colour>,
    pub(super) names: Vec<Option<String>>,
}

pub(super) fn register(builder: &Builder<'_>) -> LuaResult<()> {
    builder.object::<ColourObject>("Colour", &[], |registry| {
        registry.add_meta_method("__tostring", |_, colour, ()| Ok(colour.0.to_string()));
    })
}

impl Colours {
    /// Reads a colour or a list of colours.
    pub(super) fn parse(call: &Call<'_>, value: &LuaValue) -> Result<Colours, Refusal> {
        let mut colours = Colours::default();
        match value {
            LuaValue::Table(list) => colours.add_list(call, list)?,
            one => colours.add(call, one)?,
        }
        Ok(colours)
    }

    /// The colour name of a blob; empty if its colour has no name.
    pub(super) fn name_of(&self, blob: &Blob) -> &str {
        let name = self.names.get(blob.colour).and_then(Option::as_deref);
        name.unwrap_or_default()
    }

    fn add_list(&mut self, call: &Call<'_>, list: &LuaTable) -> Result<(), Refusal> {
        let count = list.raw_len();
        if count == 0 || count > MAX_COLOURS {
            return Err(call.args.misuse(&format!(
                "a list of colours has 1 to {MAX_COLOURS} of them, got {count}"
            )));
        }
        for index in 1..=count {
            self.add(call, &list.raw_get(index)?)?;
        }
        Ok(())
    }

    fn add(&mut self, call: &Call<'_>, value: &LuaValue) -> Result<(), Refusal> {
        let (colour, name) = match value {
            LuaValue::String(text) => {
                let name = text.to_string_lossy();
                (named(call, &name)?, Some(name))
            }
            other => (unnamed(call, other)?, None),
        };
        self.colours.push(colour);
        self.names.push(name);
        Ok(())
    }
}

/// Finds a colour of the config or a built-in one.
fn named(call: &Call<'_>, name: &str) -> Result<Colour, Refusal> {
    let own = &call.state.options.colours;
    let found = own.get(name).copied().or_else(|| Colour::named(name));
    found.ok_or_else(|| {
        let known = || own.keys().map(String::as_str).chain(Colour::NAMES);
        let near = suggestion(name, known());
        let name = super::super::failure::printable(name, 40);
        let known = known().collect::<Vec<_>>().join(", ");
        call.args
            .misuse(&format!("unknown colour '{name}'{near} (known: {known})"))
    })
}

fn unnamed(call: &Call<'_>, value: &LuaValue) -> Result<Colour, Refusal> {
    let object = value.as_userdata();
    let object = object.and_then(|object| object.borrow::<ColourObject>().ok());
    object.map(|object| object.0).ok_or_else(|| {
        call.args.misuse(&format!(
            "a colour must be a name, vision.lab{{...}} or vision.hsv{{...}}, got {}",
            describe(value)
        ))
    })
}

/// `vision.lab{l={30,70}, a={20,80}, b={10,60}}`
pub(super) fn lab(call: &mut Call<'_>) -> NativeResult {
    let options = call.args.options(0)?;
    let colour = Colour::lab(options.get("l")?, options.get("a")?, options.get("b")?);
    made(call, colour)
}

/// `vision.hsv{h={340,20}, s={50,100}, v={30,100}}`
pub(super) fn hsv(call: &mut Call<'_>) -> NativeResult {
    let options = call.args.options(0)?;
    let colour = Colour::hsv(options.get("h")?, options.get("s")?, options.get("v")?);
    made(call, colour)
}

fn made(call: &Call<'_>, colour: Result<Colour, crate::vision::ColourError>) -> NativeResult {
    let colour = colour.map_err(|error| call.args.misuse(&error.to_string()))?;
    let object = call.lua.create_any_userdata(ColourObject(colour))?;
    call.reply(object)
}
