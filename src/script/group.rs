//! `task.all`, `task.race`, `task.timeout`: tasks that live no longer than the call that made them.

use mlua::prelude::{LuaMultiValue, LuaValue};

use super::scheduler::Outcome;
use super::state::State;
use super::task::{Answer, GroupId, TaskId};

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
    fn child_done(&mut self, index: usize, mut values: LuaMultiValue) -> Option<LuaMultiValue> {
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

impl State {
    /// A child of a group has ended.
    pub(super) fn child_ended(&mut self, id: GroupId, index: usize, outcome: Outcome) {
        let Some(group) = self.groups.get_mut(&id) else {
            return;
        };
        let parent = group.parent;
        let answer = match outcome {
            Outcome::Done(values) => group.child_done(index, values).map(Answer::Values),
            Outcome::Failed(text) => Some(Answer::Failed(text)),
            Outcome::Cancelled => Some(Answer::Cancelled),
        };
        if let Some(answer) = answer {
            self.dissolve(id);
            self.tasks.wake(parent, answer, self.now);
        }
    }

    /// Ends a group: children that still live are cancelled, and run their clean-up before their
    /// parent goes on.
    pub(super) fn dissolve(&mut self, id: GroupId) {
        if let Some(group) = self.groups.remove(&id) {
            for child in group.children {
                self.cancel(child);
            }
        }
    }
}
