//! Colours as scripts write them: names, `vision.lab`, `vision.hsv`, what `vision.learn` gives, and
//! lists of these.

use mlua::prelude::{LuaResult, LuaTable, LuaValue};

use super::super::arguments::{Refusal, describe};
use super::super::nearest::suggestion;
use super::{Answered, Builder, Call};
use crate::vision::{Blob, Colour, MAX_COLOURS};

/// What the script holds of a colour without a name.
pub(super) struct ColourObject(pub(super) Colour);

/// The colours of one search, with the names under which their blobs are reported.
#[derive(Debug, Clone, Default)]
pub(super) struct Colours {
    pub(super) colours: Vec<Colour>,
    pub(super) names: Vec<Option<String>>,
}

pub(super) fn register(builder: &Builder<'_>) -> LuaResult<()> {
    let unknown = builder.strict_object("Colour")?;
    builder
        .lua
        .register_userdata_type::<ColourObject>(|registry| {
            use mlua::{UserDataFields as _, UserDataMethods as _};
            registry.add_meta_field("__type", "Colour");
            registry.add_meta_field("__index", unknown);
            registry.add_meta_method("__tostring", |_, colour, ()| Ok(colour.0.to_string()));
        })
}

impl Colours {
    /// A colour or a list of colours.
    pub(super) fn of(call: &Call<'_>, value: &LuaValue) -> Result<Colours, Refusal> {
        let mut colours = Colours::default();
        match value {
            LuaValue::Table(list) => colours.add_list(call, list)?,
            one => colours.add(call, one)?,
        }
        Ok(colours)
    }

    /// What a blob of these colours is called; nothing, if its colour has no name.
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

/// A colour of the config or one that everybody knows.
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
pub(super) fn lab(call: &mut Call<'_>) -> Answered {
    let [l, a, b] = ranges(
        call,
        [
            ("l", 0.0, 100.0),
            ("a", -128.0, 127.0),
            ("b", -128.0, 127.0),
        ],
    )?;
    made(call, Colour::lab(l, a, b))
}

/// `vision.hsv{h={340,20}, s={50,100}, v={30,100}}`
pub(super) fn hsv(call: &mut Call<'_>) -> Answered {
    let [h, s, v] = ranges(
        call,
        [("h", 0.0, 360.0), ("s", 0.0, 100.0), ("v", 0.0, 100.0)],
    )?;
    made(call, Colour::hsv(h, s, v))
}

fn made(call: &Call<'_>, colour: Result<Colour, crate::vision::ColourError>) -> Answered {
    let colour = colour.map_err(|error| call.args.misuse(&error.to_string()))?;
    let object = call.lua.create_any_userdata(ColourObject(colour))?;
    call.reply(object)
}

/// The ranges of a table, the full one for a channel that is left out.
fn ranges(call: &Call<'_>, channels: [(&str, f64, f64); 3]) -> Result<[[f64; 2]; 3], Refusal> {
    let options = call.args.options(0, &channels.map(|(name, ..)| name))?;
    let mut ranges = [[0.0; 2]; 3];
    for (range, (name, low, high)) in ranges.iter_mut().zip(channels) {
        *range = match options.value(name)? {
            LuaValue::Nil => [low, high],
            value => pair(call, name, &value)?,
        };
    }
    Ok(ranges)
}

fn pair(call: &Call<'_>, name: &str, value: &LuaValue) -> Result<[f64; 2], Refusal> {
    let wrong = || {
        call.args.misuse(&format!(
            "{name} must be two numbers, such as {name}={{20, 80}}"
        ))
    };
    let LuaValue::Table(table) = value else {
        return Err(wrong());
    };
    if table.raw_len() != 2 {
        return Err(wrong());
    }
    let number = |index: usize| -> Result<f64, Refusal> {
        let value: LuaValue = table.raw_get(index)?;
        value
            .as_number()
            .or_else(|| value.as_integer().map(|n| n as f64))
            .ok_or_else(wrong)
    };
    Ok([number(1)?, number(2)?])
}
