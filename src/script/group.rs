//! `task.all`, `task.race`, `task.timeout`: tasks that end with the call that created them.

use mlua::prelude::{LuaMultiValue, LuaValue};

use super::ids::TaskId;

/// When a group ends, and what its caller gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    /// Ends when all tasks are done; returns the first result of each.
    All,
    /// Ends when the first task is done; returns its results.
    Race,
    /// Ends when its only task is done, and returns `true` and the results. At the timeout it ends
    /// with `false, "timeout"`.
    Timeout,
}

/// One such call in progress.
pub(super) struct Group {
    pub(super) parent: TaskId,
    pub(super) rule: Rule,
    pub(super) children: Vec<TaskId>,
    pub(super) results: Vec<LuaValue>,
    pub(super) missing: usize,
}

impl Group {
    pub(super) fn new(parent: TaskId, rule: Rule, children: Vec<TaskId>) -> Group {
        let missing = children.len();
        Group {
            parent,
            rule,
            results: vec![LuaValue::Nil; missing],
            children,
            missing,
        }
    }

    /// Records that a child is done. Returns the parent's results if that ends the group.
    pub(super) fn child_done(
        &mut self,
        index: usize,
        mut values: LuaMultiValue,
    ) -> Option<LuaMultiValue> {
        match self.rule {
            Rule::Race => Some(values),
            Rule::Timeout => {
                values.push_front(LuaValue::Boolean(true));
                Some(values)
            }
            Rule::All => {
                if let Some(result) = self.results.get_mut(index) {
                    *result = values.pop_front().unwrap_or(LuaValue::Nil);
                }
                self.missing -= 1;
                (self.missing == 0).then(|| LuaMultiValue::from_vec(self.results.split_off(0)))
            }
        }
    }
}
