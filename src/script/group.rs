//! `task.all`, `task.race`, `task.timeout`: tasks that live no longer than the call that made them.

use mlua::prelude::{LuaMultiValue, LuaValue};

use super::ids::TaskId;

/// When a group is over, and what its caller gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    /// When all are done: the first result of each.
    All,
    /// When the first is done: its results.
    Race,
    /// When the one is done: `true` and its results; or `false, "timeout"`.
    Timeout,
}

/// One such call under way.
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

    /// A child is done; what the parent gets, if that ends the group.
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
