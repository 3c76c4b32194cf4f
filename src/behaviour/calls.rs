//! The system calls that a host is refused. A list of what is refused, not of what is allowed: a
//! C library that uses a call nobody thought of must not break a host, and files are landlock's
//! business. What stays is memory, time, threads, the pipe, and files that are open already.

use std::collections::BTreeMap;

use libc as sys;
use seccompiler::{
    BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition, SeccompFilter,
    SeccompRule, TargetArch, apply_filter,
};

/// Refused whatever their arguments.
const REFUSED: &[sys::c_long] = &[
    // Network, and what else reaches other processes.
    sys::SYS_socket,
    sys::SYS_connect,
    sys::SYS_bind,
    sys::SYS_listen,
    sys::SYS_accept,
    sys::SYS_accept4,
    sys::SYS_shmget,
    sys::SYS_semget,
    sys::SYS_msgget,
    sys::SYS_mq_open,
    // Programs and namespaces.
    sys::SYS_execve,
    sys::SYS_execveat,
    sys::SYS_unshare,
    sys::SYS_setns,
    sys::SYS_chroot,
    sys::SYS_personality,
    sys::SYS_memfd_create,
    // Other processes: their memory, their descriptors, their pace; signals.
    sys::SYS_ptrace,
    sys::SYS_process_vm_readv,
    sys::SYS_process_vm_writev,
    sys::SYS_process_madvise,
    sys::SYS_kcmp,
    sys::SYS_pidfd_open,
    sys::SYS_pidfd_getfd,
    sys::SYS_pidfd_send_signal,
    sys::SYS_tkill,
    sys::SYS_rt_sigqueueinfo,
    sys::SYS_rt_tgsigqueueinfo,
    sys::SYS_setpriority,
    sys::SYS_sched_setscheduler,
    sys::SYS_sched_setparam,
    sys::SYS_sched_setattr,
    sys::SYS_migrate_pages,
    sys::SYS_move_pages,
    // What changes files by their name without opening them: landlock does not see it.
    sys::SYS_fchmodat,
    sys::SYS_fchownat,
    sys::SYS_utimensat,
    sys::SYS_setxattr,
    sys::SYS_lsetxattr,
    sys::SYS_removexattr,
    sys::SYS_lremovexattr,
    sys::SYS_mknodat,
    sys::SYS_name_to_handle_at,
    sys::SYS_open_by_handle_at,
    sys::SYS_inotify_add_watch,
    sys::SYS_fanotify_init,
    // Wide doors into the kernel; the ring would make calls past this list.
    sys::SYS_io_uring_setup,
    sys::SYS_io_uring_enter,
    sys::SYS_io_uring_register,
    sys::SYS_bpf,
    sys::SYS_perf_event_open,
    sys::SYS_userfaultfd,
    sys::SYS_keyctl,
    sys::SYS_add_key,
    sys::SYS_request_key,
    // The machine's own affairs.
    sys::SYS_mount,
    sys::SYS_umount2,
    sys::SYS_pivot_root,
    sys::SYS_move_mount,
    sys::SYS_open_tree,
    sys::SYS_fsopen,
    sys::SYS_swapon,
    sys::SYS_swapoff,
    sys::SYS_reboot,
    sys::SYS_init_module,
    sys::SYS_finit_module,
    sys::SYS_delete_module,
    sys::SYS_kexec_load,
    sys::SYS_acct,
    sys::SYS_quotactl,
    sys::SYS_settimeofday,
    sys::SYS_clock_settime,
    sys::SYS_clock_adjtime,
    sys::SYS_adjtimex,
    sys::SYS_sethostname,
    sys::SYS_setdomainname,
    sys::SYS_syslog,
];

/// Older forms of the same, which other machines do not have.
#[cfg(target_arch = "x86_64")]
const REFUSED_HERE: &[sys::c_long] = &[
    sys::SYS_fork,
    sys::SYS_vfork,
    sys::SYS_chmod,
    sys::SYS_chown,
    sys::SYS_lchown,
    sys::SYS_utime,
    sys::SYS_utimes,
    sys::SYS_futimesat,
    sys::SYS_mknod,
    sys::SYS_ioperm,
    sys::SYS_iopl,
    // Numbers of their own in the x32 table, where the others are those above with X32 set.
    X32 | 520, // execve
    X32 | 545, // execveat
    X32 | 521, // ptrace
    X32 | 539, // process_vm_readv
    X32 | 540, // process_vm_writev
];
#[cfg(not(target_arch = "x86_64"))]
const REFUSED_HERE: &[sys::c_long] = &[];

/// Marks a call of the x32 table, which the same processor also understands.
#[cfg(target_arch = "x86_64")]
const X32: sys::c_long = 0x4000_0000;

/// Whether there are filters for this kind of processor.
pub(super) fn are_known() -> bool {
    architecture().is_some()
}

/// Refuses them to this thread and all that it starts; whether the kernel does.
pub(super) fn refuse() -> bool {
    let Some((missing, refused)) = programs() else {
        return false;
    };
    apply_filter(&missing)
        .and_then(|()| apply_filter(&refused))
        .is_ok()
}

fn architecture() -> Option<TargetArch> {
    TargetArch::try_from(std::env::consts::ARCH).ok()
}

/// The first answers "there is no such call", the second "not permitted".
fn programs() -> Option<(BpfProgram, BpfProgram)> {
    let refused = REFUSED
        .iter()
        .chain(REFUSED_HERE)
        .map(|&call| (call, vec![]));
    let rules: BTreeMap<_, _> = refused.chain(conditional()?).collect();
    // Its arguments cannot be seen. Told that it is missing, C libraries use `clone` for threads.
    let missing = BTreeMap::from([(sys::SYS_clone3, vec![])]);
    Some((program(missing, sys::ENOSYS)?, program(rules, sys::EPERM)?))
}

/// Refused with some arguments: processes but not threads, signals to others, pairs of sockets
/// other than local ones, limits of others.
fn conditional() -> Option<Vec<(sys::c_long, Vec<SeccompRule>)>> {
    let itself = u64::from(std::process::id());
    let thread = u64::try_from(sys::CLONE_THREAD).ok()?;
    let local = u64::try_from(sys::AF_UNIX).ok()?;
    Some(vec![
        (sys::SYS_clone, when(SeccompCmpOp::MaskedEq(thread), 0)?),
        (sys::SYS_kill, when(SeccompCmpOp::Ne, itself)?),
        (sys::SYS_tgkill, when(SeccompCmpOp::Ne, itself)?),
        (sys::SYS_socketpair, when(SeccompCmpOp::Ne, local)?),
        (sys::SYS_prlimit64, when(SeccompCmpOp::Ne, 0)?),
    ])
}

/// If the first argument is so.
fn when(compare: SeccompCmpOp, value: u64) -> Option<Vec<SeccompRule>> {
    let condition = SeccompCondition::new(0, SeccompCmpArgLen::Dword, compare, value).ok()?;
    Some(vec![SeccompRule::new(vec![condition]).ok()?])
}

fn program(rules: BTreeMap<sys::c_long, Vec<SeccompRule>>, errno: i32) -> Option<BpfProgram> {
    let answer = SeccompAction::Errno(errno.unsigned_abs());
    let filter = SeccompFilter::new(
        with_x32(rules),
        SeccompAction::Allow,
        answer,
        architecture()?,
    );
    filter.ok()?.try_into().ok()
}

#[cfg(target_arch = "x86_64")]
fn with_x32(
    rules: BTreeMap<sys::c_long, Vec<SeccompRule>>,
) -> BTreeMap<sys::c_long, Vec<SeccompRule>> {
    let twins = rules
        .clone()
        .into_iter()
        .map(|(call, rule)| (call | X32, rule));
    twins.chain(rules.clone()).collect()
}

#[cfg(not(target_arch = "x86_64"))]
fn with_x32(
    rules: BTreeMap<sys::c_long, Vec<SeccompRule>>,
) -> BTreeMap<sys::c_long, Vec<SeccompRule>> {
    rules
}
