//! The VM's interrupt, set through the C interface. This is the only file with `unsafe` code: set
//! through the safe wrapper, an interrupt makes an empty loop 2.5 times slower, this one 1.4 times,
//! because it reads one byte.
//!
//! Why this is sound: the function is only ever called by the VM, on the thread that runs it, with
//! the running coroutine; it has the calling convention that lets the VM's exceptions pass; and no
//! Rust value with a destructor is alive where it raises. The byte is reached by safe code
//! ([`budget`]).
#![allow(unsafe_code)]

use std::ffi::{CStr, c_int};
use std::mem::MaybeUninit;

use mlua::ffi;
use mlua::prelude::{Lua, LuaResult};

use super::budget::{self, BudgetVerdict};

/// Number of stack frames that are searched for a line of the script.
const DEEPEST: c_int = 64;

/// Makes `lua` check at every safepoint whether it may continue.
pub(super) fn install(lua: &Lua) -> LuaResult<()> {
    // SAFETY: the state is the one of `lua`, alive for the whole call; the callbacks' structure
    // belongs to it and no other code sets its interrupt.
    unsafe {
        lua.exec_raw::<()>((), |state| {
            (*ffi::lua_callbacks(state)).interrupt = Some(interrupt);
        })
    }
}

unsafe extern "C-unwind" fn interrupt(state: *mut ffi::lua_State, gc: c_int) {
    // The collector's interrupts must not raise.
    if gc >= 0 || !budget::is_flagged() {
        return;
    }
    // SAFETY: `state` is the running coroutine. `raise` is not reached with live destructors: the
    // message is a `&'static CStr`.
    unsafe {
        if let Some(message) = message_of(state) {
            raise(state, message);
        }
    }
}

/// The message to raise, if any. The first overrun records where it was.
unsafe fn message_of(state: *mut ffi::lua_State) -> Option<&'static CStr> {
    match budget::verdict() {
        BudgetVerdict::Continue => None,
        BudgetVerdict::Raise(message) => Some(message),
        BudgetVerdict::RaiseFirst(message) => {
            // SAFETY: as for the caller.
            if let Some((source, line)) = unsafe { where_is(state) } {
                budget::record_place(source, line);
            }
            Some(message)
        }
    }
}

/// The innermost line of the script itself.
unsafe fn where_is(state: *mut ffi::lua_State) -> Option<(String, u32)> {
    for level in 0..DEEPEST {
        let mut info = MaybeUninit::<ffi::lua_Debug>::zeroed();
        // SAFETY: `lua_Debug` is plain data, zero is a valid value of all its fields; the strings
        // that it points to live as long as the frame, and are copied before it can end.
        unsafe {
            if ffi::lua_getinfo(state, level, c"sl".as_ptr(), info.as_mut_ptr()) == 0 {
                return None;
            }
            let info = info.assume_init_ref();
            if info.currentline > 0 && !info.short_src.is_null() {
                let source = CStr::from_ptr(info.short_src).to_string_lossy();
                if !super::failure::is_runtime_frame(&source) {
                    return Some((source.into_owned(), info.currentline.unsigned_abs()));
                }
            }
        }
    }
    None
}

unsafe fn raise(state: *mut ffi::lua_State, message: &'static CStr) {
    // SAFETY: one stack slot is reserved and one value is pushed; `lua_error` does not return.
    unsafe {
        ffi::luaL_checkstack(state, 1, c"interrupt".as_ptr());
        ffi::lua_pushstring(state, message.as_ptr());
        ffi::lua_error(state)
    }
}
