//! Prepares for the next frame by repeating work on the newest one: code and data that are not in
//! the processor's caches would delay the reaction to it. Changes nothing that a script can see.

use mlua::prelude::{Lua, LuaFunction, LuaMultiValue, LuaResult};

use super::Script;
use super::api::resume_values;
use super::budget;
use super::events::Payload;
use super::sandbox;
use super::task::Answer;

/// What frame handlers typically begin with: a method of the frame, a table, a field.
const HANDLER: &str = "local red = (...):get_pixel(0, 0) local blob = { x = red } return blob.x";

/// Compiles the handler that [`Script::warm_up`] runs.
pub(super) fn handler(lua: &Lua) -> LuaResult<LuaFunction> {
    sandbox::compile(lua, HANDLER, "@spykee/warm-up")
}

impl Script {
    /// Examines the newest frame again and runs a handler without effects. Does nothing if the
    /// script has not examined that frame.
    pub fn warm_up(&mut self) {
        let mut state = self.state.borrow_mut();
        let frames = &mut state.frames;
        let Some(held) = frames.newest.clone() else {
            return;
        };
        if frames.analyser.last_frame() != Some(held.frame.seq) {
            return;
        }
        frames.analyser.warm_caches(&held.frame.jpeg);
        let (limit, chunk) = (
            state.options.limits.callback_budget(),
            state.options.chunk.clone(),
        );
        drop(state);
        budget::begin(limit, &chunk);
        // It fails if the VM has no memory left; the script itself will report that.
        let _ = self.run_handler(Answer::Deliver(Payload::Frame(held)));
        budget::end();
    }

    fn run_handler(&self, answer: Answer) -> LuaResult<()> {
        let values = resume_values(&self.lua, answer)?;
        let frame = values
            .front()
            .and_then(|value| value.as_userdata())
            .cloned();
        let thread = self.lua.create_thread(self.warm_up_handler.clone())?;
        let result = thread.resume::<LuaMultiValue>(values);
        // Releases the frame now rather than at the next garbage collection.
        if let Some(frame) = frame {
            frame.destroy()?;
        }
        result.map(drop)
    }
}
