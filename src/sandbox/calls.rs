//! The seccomp allow-list of a confined process: every other system call fails with an error. The
//! list was measured with every script in `tests/hostile`, every shipped behaviour, scenarios and
//! checks. Landlock, not this list, decides which files can be opened.

use std::collections::BTreeMap;

use libc as sys;
use seccompiler::{
    BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition, SeccompFilter,
    SeccompRule, TargetArch, apply_filter,
};

type Rules = BTreeMap<sys::c_long, Vec<SeccompRule>>;

#[cfg(target_pointer_width = "64")]
const ALLOWED: &[sys::c_long] = &[
    // Memory; the calls that map it have conditions.
    sys::SYS_brk,
    sys::SYS_munmap,
    sys::SYS_mremap,
    sys::SYS_madvise,
    // Clocks, timers and polling.
    sys::SYS_clock_gettime,
    sys::SYS_clock_getres,
    sys::SYS_clock_nanosleep,
    sys::SYS_nanosleep,
    sys::SYS_gettimeofday,
    sys::SYS_restart_syscall,
    sys::SYS_epoll_create1,
    sys::SYS_epoll_ctl,
    sys::SYS_epoll_pwait,
    sys::SYS_eventfd2,
    sys::SYS_ppoll,
    // The process's own threads, their signals and their exit.
    sys::SYS_futex,
    sys::SYS_set_robust_list,
    sys::SYS_rseq,
    sys::SYS_set_tid_address,
    sys::SYS_gettid,
    sys::SYS_getpid,
    sys::SYS_getppid,
    sys::SYS_getuid,
    sys::SYS_geteuid,
    sys::SYS_getgid,
    sys::SYS_getegid,
    sys::SYS_sched_yield,
    sys::SYS_sched_getaffinity,
    sys::SYS_sigaltstack,
    sys::SYS_rt_sigaction,
    sys::SYS_rt_sigprocmask,
    sys::SYS_rt_sigreturn,
    sys::SYS_exit,
    sys::SYS_exit_group,
    sys::SYS_getrandom,
    // The pipe and files that are already open.
    sys::SYS_read,
    sys::SYS_write,
    sys::SYS_readv,
    sys::SYS_writev,
    sys::SYS_pread64,
    sys::SYS_pwrite64,
    sys::SYS_lseek,
    sys::SYS_close,
    sys::SYS_dup,
    sys::SYS_shutdown,
    sys::SYS_getsockopt,
    sys::SYS_recvfrom,
    sys::SYS_fstat,
    sys::SYS_fstatfs,
    sys::SYS_fsync,
    sys::SYS_fdatasync,
    sys::SYS_ftruncate,
    sys::SYS_getdents64,
    // Calls that take file names: landlock restricts them.
    sys::SYS_openat,
    sys::SYS_newfstatat,
    sys::SYS_statx,
    sys::SYS_statfs,
    sys::SYS_faccessat,
    sys::SYS_faccessat2,
    sys::SYS_mkdirat,
    sys::SYS_unlinkat,
    sys::SYS_renameat,
    sys::SYS_renameat2,
    sys::SYS_readlinkat,
    sys::SYS_getcwd,
    // Refused by the other filter with the error that C libraries expect.
    sys::SYS_clone3,
];
#[cfg(not(target_pointer_width = "64"))]
const ALLOWED: &[sys::c_long] = &[];

/// Older forms of the same calls, which other architectures do not have. The x32 system call table
/// has separate numbers, so none of it is allowed.
#[cfg(target_arch = "x86_64")]
const ALLOWED_HERE: &[sys::c_long] = &[
    sys::SYS_epoll_wait,
    sys::SYS_poll,
    sys::SYS_open,
    sys::SYS_stat,
    sys::SYS_lstat,
    sys::SYS_access,
    sys::SYS_mkdir,
    sys::SYS_rmdir,
    sys::SYS_unlink,
    sys::SYS_rename,
    sys::SYS_readlink,
];
#[cfg(not(target_arch = "x86_64"))]
const ALLOWED_HERE: &[sys::c_long] = &[];

/// The `clone` flags with which glibc creates a thread.
const GNU_THREAD: i32 = sys::CLONE_VM
    | sys::CLONE_FS
    | sys::CLONE_FILES
    | sys::CLONE_SIGHAND
    | sys::CLONE_THREAD
    | sys::CLONE_SYSVSEM
    | sys::CLONE_SETTLS
    | sys::CLONE_PARENT_SETTID
    | sys::CLONE_CHILD_CLEARTID;
/// The flags that musl uses.
const MUSL_THREAD: i32 = GNU_THREAD | sys::CLONE_DETACHED;
/// The allowed `fcntl` commands; those that set a file's signal recipient or a lease are refused.
const FCNTL: &[i32] = &[
    sys::F_DUPFD_CLOEXEC,
    sys::F_GETFD,
    sys::F_SETFD,
    sys::F_GETFL,
    sys::F_SETFL,
];
/// The allowed `prctl` operations: naming threads, and finding the vDSO, without which every clock
/// read would be a system call.
const PRCTL: &[i32] = &[sys::PR_SET_NAME, PR_GET_AUXV];
const PR_GET_AUXV: i32 = 0x4155_5856;

/// Whether a filter exists for this processor architecture.
pub(super) fn is_supported() -> bool {
    !ALLOWED.is_empty() && architecture().is_some()
}

/// Restricts this thread and everything it starts to the allow-list; with `serves`, connections can be
/// accepted, too. Returns whether the kernel has applied it.
pub(super) fn restrict(serves: bool) -> bool {
    let Some((missing, allowed)) = programs(serves) else {
        return false;
    };
    apply_filter(&missing)
        .and_then(|()| apply_filter(&allowed))
        .is_ok()
}

fn architecture() -> Option<TargetArch> {
    TargetArch::try_from(std::env::consts::ARCH).ok()
}

/// Builds two filters. The first returns `ENOSYS` for a call that C libraries can replace with
/// another one; the second returns `EPERM` for every call that is not allowed.
fn programs(serves: bool) -> Option<(BpfProgram, BpfProgram)> {
    if !is_supported() {
        return None;
    }
    let mut rules: Rules = ALLOWED
        .iter()
        .chain(ALLOWED_HERE)
        .map(|&call| (call, vec![]))
        .collect();
    if serves {
        rules.insert(sys::SYS_accept4, vec![]);
    }
    rules.extend(conditional()?);
    let refused = |errno: i32| SeccompAction::Errno(errno.unsigned_abs());
    let allowed = filter(rules, refused(sys::EPERM), SeccompAction::Allow)?;
    // A filter cannot inspect the arguments of `clone3`. On `ENOSYS`, C libraries fall back to
    // `clone`.
    let missing = BTreeMap::from([(sys::SYS_clone3, vec![])]);
    let missing = filter(missing, SeccompAction::Allow, refused(sys::ENOSYS))?;
    Some((missing, allowed))
}

fn filter(rules: Rules, otherwise: SeccompAction, then: SeccompAction) -> Option<BpfProgram> {
    let filter = SeccompFilter::new(rules, otherwise, then, architecture()?);
    filter.ok()?.try_into().ok()
}

#[cfg(target_pointer_width = "64")]
fn conditional() -> Option<Rules> {
    let itself = i32::try_from(std::process::id()).ok()?;
    // Nothing that is mapped after the start can be executable: no new code can be loaded.
    let not_executable = || {
        low_word(
            2,
            SeccompCmpOp::MaskedEq(u64::from(bits(sys::PROT_EXEC))),
            0,
        )
    };
    Some(BTreeMap::from([
        (sys::SYS_mmap, vec![not_executable()?]),
        (sys::SYS_mprotect, vec![not_executable()?]),
        (sys::SYS_clone, one_of(0, &[GNU_THREAD, MUSL_THREAD])?),
        (sys::SYS_tgkill, one_of(0, &[itself])?),
        (sys::SYS_fcntl, one_of(1, FCNTL)?),
        (sys::SYS_prctl, one_of(0, PRCTL)?),
        (
            sys::SYS_ioctl,
            vec![low_word(1, SeccompCmpOp::Eq, sys::FIONBIO)?],
        ),
        (sys::SYS_socketpair, one_of(0, &[sys::AF_UNIX])?),
        // Only to the connected peer: no destination address. Unlike `sendmsg`, it cannot pass
        // descriptors.
        (sys::SYS_sendto, vec![is_null(4)?]),
        // Reads a limit; setting one is refused.
        (sys::SYS_prlimit64, vec![is_null(2)?]),
    ]))
}
#[cfg(not(target_pointer_width = "64"))]
fn conditional() -> Option<Rules> {
    None
}

fn bits(flags: i32) -> u32 {
    u32::from_ne_bytes(flags.to_ne_bytes())
}

fn one_of(argument: u8, values: &[i32]) -> Option<Vec<SeccompRule>> {
    let rules = values
        .iter()
        .map(|&value| low_word(argument, SeccompCmpOp::Eq, bits(value).into()));
    rules.collect()
}

/// Matches if the lower 32 bits of this argument satisfy the comparison.
fn low_word(argument: u8, compare: SeccompCmpOp, value: u64) -> Option<SeccompRule> {
    rule(argument, SeccompCmpArgLen::Dword, compare, value)
}

/// Matches if this pointer is null.
fn is_null(argument: u8) -> Option<SeccompRule> {
    rule(argument, SeccompCmpArgLen::Qword, SeccompCmpOp::Eq, 0)
}

fn rule(
    argument: u8,
    length: SeccompCmpArgLen,
    compare: SeccompCmpOp,
    value: u64,
) -> Option<SeccompRule> {
    let condition = SeccompCondition::new(argument, length, compare, value).ok()?;
    SeccompRule::new(vec![condition]).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_call_is_listed_twice_and_the_filters_fit_into_the_kernel() {
        let all: Vec<_> = ALLOWED.iter().chain(ALLOWED_HERE).collect();
        let conditional = conditional().unwrap();
        for (at, call) in all.iter().enumerate() {
            assert!(!all[..at].contains(call), "{call} twice");
            assert!(!conditional.contains_key(call), "{call} has a condition");
        }
        let (missing, allowed) = programs(false).unwrap();
        assert!(missing.len() < 4096 && allowed.len() < 4096);
    }
}
