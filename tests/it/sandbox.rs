//! The confinement of a live host by the kernel: the test injects system calls into it, as code
//! that has escaped from the VM would make them, and each must be refused.

use std::path::Path;
use std::process::{Command as Process, Stdio};
use std::time::Duration;

use spykee::wire::Command;
use tokio::time::timeout;

use crate::rig::{Rig, WAIT_LIMIT, assert_contains, children_of};

/// Switches a light on when it runs, and waits.
const WAITS: &str = "robot.led('left', true) task.wait(1000)";

async fn waiting() -> (Rig, crate::rig::Run) {
    let rig = Rig::quiet().await;
    let run = rig.run(WAITS);
    rig.heard(0, |command| matches!(command, Command::Led { .. }))
        .await;
    (rig, run)
}

fn proc(pid: rustix::process::Pid, file: &str) -> String {
    let path = format!("/proc/{}/{file}", pid.as_raw_nonzero());
    std::fs::read_to_string(path).unwrap()
}

fn line<'a>(text: &'a str, key: &str) -> &'a str {
    let found = text.lines().find_map(|line| line.strip_prefix(key));
    found.unwrap_or_else(|| panic!("no {key} in {text}")).trim()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_host_has_no_privileges_few_resources_and_a_lower_priority_than_its_agent() {
    let (_rig, run) = waiting().await;
    let [host] = run.hosts()[..] else {
        panic!("not one host")
    };
    let status = proc(host, "status");
    for key in ["CapInh:", "CapPrm:", "CapEff:", "CapAmb:"] {
        assert_eq!(line(&status, key), "0000000000000000", "{key}");
    }
    assert_eq!(line(&status, "NoNewPrivs:"), "1");
    assert_eq!(line(&status, "Seccomp:"), "2");
    assert_eq!(proc(host, "oom_score_adj").trim(), "500");
    // The fields after the name in brackets begin with the third; niceness is the nineteenth.
    let stat = proc(host, "stat");
    let nice = stat.rsplit_once(')').unwrap().1.split_whitespace().nth(16);
    let agents = proc(run.pid(), "stat");
    let agents = agents
        .rsplit_once(')')
        .unwrap()
        .1
        .split_whitespace()
        .nth(16);
    let number = |nice: Option<&str>| nice.unwrap().parse::<i32>().unwrap();
    assert_eq!(number(nice), (number(agents) + 5).min(19));
    let limits = proc(host, "limits");
    for (key, most) in [
        ("Max address space", 1 << 30),
        ("Max open files", 32),
        ("Max file size", 16 << 20),
        ("Max core file size", 0),
        ("Max locked memory", 0),
        ("Max cpu time", 100 * 86_400),
        ("Max realtime priority", 0),
    ] {
        let values: Vec<u64> = line(&limits, key)
            .split_whitespace()
            .filter_map(|word| word.parse().ok())
            .collect();
        assert!(
            values.len() == 2 && values.iter().all(|one| *one <= most),
            "{key} {values:?}"
        );
    }
    assert_ne!(
        line(&limits, "Max processes").split_whitespace().next(),
        Some("unlimited")
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn no_descriptor_inherited_by_the_agent_reaches_its_children() {
    let rig = Rig::quiet().await;
    let script = rig.file("script.lua", WAITS);
    let command = format!(
        "exec '{}' run '{}' --robot {} 7</etc/passwd 8<> leak 9< .",
        env!("CARGO_BIN_EXE_spykee"),
        script.display(),
        rig.address
    );
    let mut agent = Process::new("/bin/sh")
        .args(["-c", &command])
        .current_dir(rig.folder())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let lit = |command: &Command| matches!(command, Command::Led { .. });
    timeout(WAIT_LIMIT, rig.sim.wait_heard(0, lit))
        .await
        .unwrap();
    let pid = rustix::process::Pid::from_child(&agent);
    let leaks = |pid: rustix::process::Pid| {
        let folder = format!("/proc/{}/fd", pid.as_raw_nonzero());
        let entries = std::fs::read_dir(folder).ok()?;
        let links = entries.filter_map(|entry| std::fs::read_link(entry.ok()?.path()).ok());
        let of_ours = |link: &std::path::PathBuf| {
            link == Path::new("/etc/passwd") || link.starts_with(rig.folder())
        };
        Some(links.filter(of_ours).count())
    };
    // It opens files of its own there too.
    assert!(leaks(pid) >= Some(3), "the agent did not inherit them");
    let children = children_of(pid);
    assert_eq!(children.len(), 2, "a host and the guardian");
    // Only root can inspect a host.
    let looked: Vec<usize> = children.into_iter().filter_map(leaks).collect();
    assert!(
        !looked.is_empty() && looked.iter().all(|leaks| *leaks == 0),
        "{looked:?}"
    );
    agent.kill().unwrap();
    agent.wait().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_host_without_motion_that_sends_no_sign_of_life_is_ended_too() {
    let rig = Rig::quiet().await;
    let script = rig.file("script.lua", WAITS);
    let script = script.to_str().unwrap();
    let mut run = rig.spykee(&["run", script, "--robot", &rig.address]);
    rig.heard(0, |command| matches!(command, Command::Led { .. }))
        .await;
    // A host that sends signs of life, but nothing else, is not ended.
    tokio::time::sleep(Duration::from_secs(7)).await;
    assert!(run.lives(), "{}", run.text());
    let [host] = run.hosts()[..] else {
        panic!("not one host")
    };
    rustix::process::kill_process(host, rustix::process::Signal::STOP).unwrap();
    assert_eq!(run.code().await, Some(1), "{}", run.text());
    assert_contains(&run.text(), &["showed no life for 5 s"]);
}

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod injected {
    use std::ffi::c_void;

    use libc as sys;
    use nix::sys::ptrace;
    use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
    use nix::unistd::Pid;

    use super::*;

    /// The differences between processors: the registers of a call, and the calls that only one of
    /// them has.
    #[cfg(target_arch = "x86_64")]
    mod processor {
        use super::*;

        pub type Registers = sys::user_regs_struct;
        const X32: i64 = 0x4000_0000;
        /// `syscall`, as the bytes appear in a word of memory.
        const SYSCALL: i64 = 0x050f;

        pub fn read(pid: Pid) -> Registers {
            ptrace::getregs(pid).unwrap()
        }

        pub fn write(pid: Pid, registers: Registers) {
            ptrace::setregs(pid, registers).unwrap();
        }

        /// The address of the instruction by which it waits in the kernel.
        pub fn gate(pid: Pid, registers: &Registers) -> u64 {
            let at = registers.rip - 2;
            let found = ptrace::read(pid, at as *mut c_void).unwrap();
            assert_eq!(found & 0xffff, SYSCALL, "not inside a system call");
            at
        }

        pub fn calling(before: Registers, gate: u64, call: i64, arguments: [u64; 6]) -> Registers {
            let [rdi, rsi, rdx, r10, r8, r9] = arguments;
            Registers {
                rip: gate,
                rax: call.cast_unsigned(),
                // Prevents the kernel from restarting an interrupted call.
                orig_rax: u64::MAX,
                rdi,
                rsi,
                rdx,
                r10,
                r8,
                r9,
                ..before
            }
        }

        pub fn answer(registers: &Registers) -> i64 {
            registers.rax.cast_signed()
        }

        pub const OWN: &[(&str, i64)] = &[
            ("execve of x32", X32 | 520),
            ("ptrace of x32", X32 | 521),
            ("getpid of x32", X32 | sys::SYS_getpid),
            ("fork", sys::SYS_fork),
            ("vfork", sys::SYS_vfork),
            ("modify_ldt", sys::SYS_modify_ldt),
            ("arch_prctl", sys::SYS_arch_prctl),
            ("chmod", sys::SYS_chmod),
            ("chown", sys::SYS_chown),
            ("link", sys::SYS_link),
            ("symlink", sys::SYS_symlink),
            ("iopl", sys::SYS_iopl),
            ("ioperm", sys::SYS_ioperm),
        ];
    }
    #[cfg(target_arch = "aarch64")]
    mod processor {
        use super::*;
        use nix::sys::ptrace::regset::NT_PRSTATUS;

        pub type Registers = sys::user_regs_struct;
        /// `svc #0`.
        const SYSCALL: i64 = 0xd400_0001;

        pub fn read(pid: Pid) -> Registers {
            ptrace::getregset::<NT_PRSTATUS>(pid).unwrap()
        }

        pub fn write(pid: Pid, registers: Registers) {
            ptrace::setregset::<NT_PRSTATUS>(pid, registers).unwrap();
        }

        /// The address of the instruction by which it waits in the kernel: the one before the
        /// program counter, or at it if the kernel will restart the call.
        pub fn gate(pid: Pid, registers: &Registers) -> u64 {
            let is_call = |at: &u64| {
                let found = ptrace::read(pid, *at as *mut c_void).unwrap();
                found & 0xffff_ffff == SYSCALL
            };
            let mut places = [registers.pc - 4, registers.pc].into_iter();
            places.find(is_call).expect("not inside a system call")
        }

        pub fn calling(before: Registers, gate: u64, call: i64, arguments: [u64; 6]) -> Registers {
            let mut registers = before;
            registers.regs[..6].copy_from_slice(&arguments);
            registers.regs[8] = call.cast_unsigned();
            registers.pc = gate;
            registers
        }

        pub fn answer(registers: &Registers) -> i64 {
            registers.regs[0].cast_signed()
        }

        pub const OWN: &[(&str, i64)] = &[("a call of the processor", 0x0f_0001)];
    }
    use processor::{OWN, Registers, answer, calling, gate, read, write};

    /// The calls that must be refused, with their arguments. Pointers are invalid: the refusal must
    /// come before the kernel reads them.
    fn refused(host: u64, agent: u64, code: u64) -> Vec<(&'static str, i64, [u64; 6])> {
        let plain = [
            ("socket", sys::SYS_socket),
            ("connect", sys::SYS_connect),
            ("bind", sys::SYS_bind),
            ("listen", sys::SYS_listen),
            ("accept", sys::SYS_accept),
            ("accept4", sys::SYS_accept4),
            ("sendmsg", sys::SYS_sendmsg),
            ("sendmmsg", sys::SYS_sendmmsg),
            ("recvmsg", sys::SYS_recvmsg),
            ("recvmmsg", sys::SYS_recvmmsg),
            ("setsockopt", sys::SYS_setsockopt),
            ("shmget", sys::SYS_shmget),
            ("semget", sys::SYS_semget),
            ("msgget", sys::SYS_msgget),
            ("mq_open", sys::SYS_mq_open),
            ("execve", sys::SYS_execve),
            ("execveat", sys::SYS_execveat),
            ("unshare", sys::SYS_unshare),
            ("setns", sys::SYS_setns),
            ("chroot", sys::SYS_chroot),
            ("pivot_root", sys::SYS_pivot_root),
            ("personality", sys::SYS_personality),
            ("memfd_create", sys::SYS_memfd_create),
            ("memfd_secret", 447),
            ("ptrace", sys::SYS_ptrace),
            ("process_vm_readv", sys::SYS_process_vm_readv),
            ("process_vm_writev", sys::SYS_process_vm_writev),
            ("process_madvise", 440),
            ("process_mrelease", 448),
            ("kcmp", sys::SYS_kcmp),
            ("pidfd_open", sys::SYS_pidfd_open),
            ("pidfd_getfd", 438),
            ("pidfd_send_signal", sys::SYS_pidfd_send_signal),
            ("kill", sys::SYS_kill),
            ("tkill", sys::SYS_tkill),
            ("rt_sigqueueinfo", sys::SYS_rt_sigqueueinfo),
            ("rt_tgsigqueueinfo", sys::SYS_rt_tgsigqueueinfo),
            ("setpriority", sys::SYS_setpriority),
            ("sched_setaffinity", sys::SYS_sched_setaffinity),
            ("sched_setscheduler", sys::SYS_sched_setscheduler),
            ("sched_setparam", sys::SYS_sched_setparam),
            ("sched_setattr", sys::SYS_sched_setattr),
            ("ioprio_set", sys::SYS_ioprio_set),
            ("setrlimit", sys::SYS_setrlimit),
            ("migrate_pages", sys::SYS_migrate_pages),
            ("move_pages", sys::SYS_move_pages),
            ("mlockall", sys::SYS_mlockall),
            ("pkey_mprotect", sys::SYS_pkey_mprotect),
            ("remap_file_pages", sys::SYS_remap_file_pages),
            ("shmat", sys::SYS_shmat),
            ("fchmodat", sys::SYS_fchmodat),
            ("fchmodat2", 452),
            ("fchmod", sys::SYS_fchmod),
            ("fchownat", sys::SYS_fchownat),
            ("utimensat", sys::SYS_utimensat),
            ("setxattr", sys::SYS_setxattr),
            ("lsetxattr", sys::SYS_lsetxattr),
            ("fsetxattr", sys::SYS_fsetxattr),
            ("setxattrat", 463),
            ("removexattr", sys::SYS_removexattr),
            ("removexattrat", 466),
            ("file_setattr", 469),
            ("open_tree", 428),
            ("open_tree_attr", 467),
            ("move_mount", 429),
            ("fsopen", 430),
            ("mount_setattr", 442),
            ("mknodat", sys::SYS_mknodat),
            ("linkat", sys::SYS_linkat),
            ("symlinkat", sys::SYS_symlinkat),
            ("truncate", sys::SYS_truncate),
            ("chdir", sys::SYS_chdir),
            ("umask", sys::SYS_umask),
            ("name_to_handle_at", sys::SYS_name_to_handle_at),
            ("open_by_handle_at", sys::SYS_open_by_handle_at),
            ("openat2", sys::SYS_openat2),
            ("inotify_init1", sys::SYS_inotify_init1),
            ("inotify_add_watch", sys::SYS_inotify_add_watch),
            ("fanotify_init", sys::SYS_fanotify_init),
            ("io_uring_setup", sys::SYS_io_uring_setup),
            ("io_uring_enter", sys::SYS_io_uring_enter),
            ("io_uring_register", sys::SYS_io_uring_register),
            ("io_setup", sys::SYS_io_setup),
            ("bpf", sys::SYS_bpf),
            ("perf_event_open", sys::SYS_perf_event_open),
            ("userfaultfd", sys::SYS_userfaultfd),
            ("keyctl", sys::SYS_keyctl),
            ("add_key", sys::SYS_add_key),
            ("request_key", sys::SYS_request_key),
            ("seccomp", sys::SYS_seccomp),
            ("landlock_create_ruleset", 444),
            ("capset", sys::SYS_capset),
            ("setuid", sys::SYS_setuid),
            ("setresgid", sys::SYS_setresgid),
            ("setgroups", sys::SYS_setgroups),
            ("setsid", sys::SYS_setsid),
            ("setpgid", sys::SYS_setpgid),
            ("mount", sys::SYS_mount),
            ("umount2", sys::SYS_umount2),
            ("swapon", sys::SYS_swapon),
            ("reboot", sys::SYS_reboot),
            ("init_module", sys::SYS_init_module),
            ("finit_module", sys::SYS_finit_module),
            ("kexec_load", sys::SYS_kexec_load),
            ("acct", sys::SYS_acct),
            ("quotactl", sys::SYS_quotactl),
            ("settimeofday", sys::SYS_settimeofday),
            ("clock_settime", sys::SYS_clock_settime),
            ("clock_adjtime", sys::SYS_clock_adjtime),
            ("sethostname", sys::SYS_sethostname),
            ("syslog", sys::SYS_syslog),
            ("timer_create", sys::SYS_timer_create),
            ("signalfd4", sys::SYS_signalfd4),
            ("splice", sys::SYS_splice),
            ("vmsplice", sys::SYS_vmsplice),
            ("no such call", 4000),
        ];
        let number = |flag: i32| u64::from(flag.unsigned_abs());
        let (anonymous, none) = (number(sys::MAP_PRIVATE | sys::MAP_ANONYMOUS), u64::MAX);
        let page = code & !0xfff;
        let plain = plain.iter().chain(OWN);
        let mut all: Vec<_> = plain.map(|&(name, call)| (name, call, [0; 6])).collect();
        all.extend([
            (
                "mmap to write and run",
                sys::SYS_mmap,
                [0, 4096, 7, anonymous, none, 0],
            ),
            (
                "mmap to run",
                sys::SYS_mmap,
                [0, 4096, 5, anonymous, none, 0],
            ),
            (
                "mprotect of code to write",
                sys::SYS_mprotect,
                [page, 4096, 7, 0, 0, 0],
            ),
            (
                "mprotect to run",
                sys::SYS_mprotect,
                [page, 4096, 5, 0, 0, 0],
            ),
            ("prctl PR_SET_PDEATHSIG", sys::SYS_prctl, [1, 0, 0, 0, 0, 0]),
            ("prctl PR_SET_DUMPABLE", sys::SYS_prctl, [4, 1, 0, 0, 0, 0]),
            ("prctl PR_SET_SECCOMP", sys::SYS_prctl, [22, 0, 0, 0, 0, 0]),
            (
                "clone of a process",
                sys::SYS_clone,
                [number(sys::SIGCHLD), 0, 0, 0, 0, 0],
            ),
            (
                "clone of a namespace",
                sys::SYS_clone,
                [number(sys::CLONE_NEWUSER), 0, 0, 0, 0, 0],
            ),
            (
                "tgkill of the agent",
                sys::SYS_tgkill,
                [agent, agent, 0, 0, 0, 0],
            ),
            (
                "prlimit64 of the agent",
                sys::SYS_prlimit64,
                [agent, 0, 1, 0, 0, 0],
            ),
            (
                "prlimit64 of its own",
                sys::SYS_prlimit64,
                [host, 0, 1, 0, 0, 0],
            ),
            (
                "socketpair of the network",
                sys::SYS_socketpair,
                [2, 1, 0, 0, 0, 0],
            ),
            ("fcntl F_SETOWN", sys::SYS_fcntl, [0, 8, agent, 0, 0, 0]),
            ("fcntl F_NOTIFY", sys::SYS_fcntl, [0, 1026, 0, 0, 0, 0]),
            ("ioctl TIOCSTI", sys::SYS_ioctl, [0, 0x5412, 0, 0, 0, 0]),
            ("ioctl SIOCGIFCONF", sys::SYS_ioctl, [0, 0x8912, 0, 0, 0, 0]),
            (
                "sendto with an address",
                sys::SYS_sendto,
                [0, 0, 0, 0, page, 16],
            ),
        ]);
        all
    }

    /// A process that is stopped inside a system call.
    struct Stopped {
        pid: Pid,
        registers: Registers,
        gate: u64,
    }

    impl Stopped {
        /// `None` if this user has no permission.
        fn attach(pid: Pid) -> Option<Stopped> {
            if let Err(error) = ptrace::attach(pid) {
                eprintln!("calls cannot be injected by this user: {error}");
                return None;
            }
            waitpid(pid, Some(WaitPidFlag::__WALL)).unwrap();
            let registers = read(pid);
            let gate = gate(pid, &registers);
            Some(Stopped {
                pid,
                registers,
                gate,
            })
        }

        fn call(&self, call: i64, arguments: [u64; 6]) -> i64 {
            write(
                self.pid,
                calling(self.registers, self.gate, call, arguments),
            );
            ptrace::step(self.pid, None).unwrap();
            let stopped = waitpid(self.pid, Some(WaitPidFlag::__WALL)).unwrap();
            assert!(
                matches!(stopped, WaitStatus::Stopped(..)),
                "{call}: {stopped:?}"
            );
            answer(&read(self.pid))
        }

        fn detach(self) {
            write(self.pid, self.registers);
            ptrace::detach(self.pid, None).unwrap();
        }
    }

    fn inject(host: i32, agent: i32) -> Option<usize> {
        let stopped = Stopped::attach(Pid::from_raw(host))?;
        // Permitted calls work, so the others fail because they are refused, not because the
        // injection is broken.
        assert_eq!(stopped.call(sys::SYS_getpid, [0; 6]), i64::from(host));
        let anonymous = u64::from((sys::MAP_PRIVATE | sys::MAP_ANONYMOUS).unsigned_abs());
        let memory = stopped.call(sys::SYS_mmap, [0, 4096, 3, anonymous, u64::MAX, 0]);
        assert!(memory > 0, "memory: {memory}");
        assert_eq!(
            stopped.call(sys::SYS_munmap, [memory.cast_unsigned(), 4096, 0, 0, 0, 0]),
            0
        );
        let missing = stopped.call(sys::SYS_clone3, [0; 6]);
        assert_eq!(missing, -i64::from(sys::ENOSYS), "clone3");
        let [host, agent] = [host, agent].map(|pid| u64::from(pid.unsigned_abs()));
        let all = refused(host, agent, stopped.gate);
        let mut broken = Vec::new();
        for (name, call, arguments) in &all {
            let answer = stopped.call(*call, *arguments);
            if answer != -i64::from(sys::EPERM) {
                broken.push(format!("{name} answered {answer}"));
            }
        }
        stopped.detach();
        assert!(broken.is_empty(), "{broken:#?}");
        Some(all.len())
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn a_live_host_is_refused_every_call_that_it_does_not_need() {
        let (rig, mut run) = waiting().await;
        let [host] = run.hosts()[..] else {
            panic!("not one host")
        };
        let host = host.as_raw_nonzero().get();
        let agent = run.pid().as_raw_nonzero().get();
        // Only the thread that attached may trace.
        let injected = tokio::task::spawn_blocking(move || inject(host, agent));
        let count = injected.await.unwrap();
        eprintln!("{count:?} calls refused");
        // The host continues unharmed.
        let from = rig.sim.heard_count();
        run.signal(rustix::process::Signal::TERM);
        assert_eq!(run.code().await, Some(130), "{}", run.text());
        rig.heard_stop(from).await;
    }
}
