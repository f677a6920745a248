//! Ctrl-C, SIGTERM and a closed terminal: what a command does then, and the exit code that says so.

use std::error::Error;
use std::fmt;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

/// A signal this soon after the first one is a copy of it: a terminal, `timeout` or a scheduler may send it both to the
/// process and to its group.
const SAME_SIGNAL: Duration = Duration::from_secs(1);

/// Ctrl-C, by its number on Unix.
const INTERRUPT: u8 = 2;

/// What a shell adds to the number of the signal that ended a program.
const BASE: u8 = 128;

/// The first signal that came; 0: none.
static FIRST: AtomicU8 = AtomicU8::new(0);

/// A signal interrupted unfinished work; the sentence says what is left of it.
#[derive(Debug)]
pub struct Stopped(pub &'static str);

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

impl Error for Stopped {}

/// The exit code of a program that a signal has stopped: 128 and the signal's number, as shells have it; none without a signal.
pub fn exit_code() -> Option<ExitCode> {
    match FIRST.load(Ordering::SeqCst) {
        0 => None,
        signal => Some(ExitCode::from(BASE + signal)),
    }
}

/// Ends the program with [`exit_code`] if a signal has come.
pub fn exit_if_stopped() {
    match FIRST.load(Ordering::SeqCst) {
        0 => {}
        signal => std::process::exit(i32::from(BASE + signal)),
    }
}

/// Whether this exit code is [`exit_code`] after a signal.
pub fn is_stopped(code: Option<i32>) -> bool {
    let known = [INTERRUPT].into_iter().chain(more());
    known.into_iter().any(|signal| code == Some(i32::from(BASE + signal)))
}

/// Forgets the signals that came: the program goes on, and the next one is the first again.
pub fn forget() {
    FIRST.store(0, Ordering::SeqCst);
}

/// Calls `stop` at the first Ctrl-C, SIGTERM or closed terminal. A later one calls it again and ends the program at once.
pub fn on_stop(stop: impl Fn() + Send + 'static) {
    let mut begun: Option<Instant> = None;
    listen(move |signal| match begun.filter(|_| FIRST.load(Ordering::SeqCst) != 0) {
        None => {
            begun = Some(Instant::now());
            FIRST.store(signal, Ordering::SeqCst);
            stop();
        }
        Some(begun) if begun.elapsed() > SAME_SIGNAL => {
            stop();
            end_now();
        }
        Some(_) => {}
    });
}

/// Calls `received` with the number of every signal, on a thread of its own.
#[cfg(unix)]
fn listen(mut received: impl FnMut(u8) + Send + 'static) {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    // `nohup` has the end of the terminal ignored.
    let wanted = [SIGINT, SIGTERM].into_iter().chain((!is_ignored(SIGHUP)).then_some(SIGHUP));
    let Ok(mut signals) = signal_hook::iterator::Signals::new(wanted) else { return };
    std::thread::spawn(move || {
        signals.forever().for_each(|signal| received(u8::try_from(signal).unwrap_or(INTERRUPT)))
    });
}

/// Calls `received` at every Ctrl-C.
#[cfg(not(unix))]
fn listen(mut received: impl FnMut(u8) + Send + 'static) {
    // A process can have one handler only; an existing one (in tests) stays.
    let _ = ctrlc::set_handler(move || received(INTERRUPT));
}

/// The other signals that stop a command.
#[cfg(unix)]
fn more() -> impl Iterator<Item = u8> {
    use signal_hook::consts::{SIGHUP, SIGTERM};
    [SIGHUP, SIGTERM].into_iter().filter_map(|signal| u8::try_from(signal).ok())
}

/// The other signals that stop a command.
#[cfg(not(unix))]
fn more() -> impl Iterator<Item = u8> {
    std::iter::empty()
}

/// Whether this process was started with a signal ignored, where the system has a file that says so.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Ends the program without the cleanup of an orderly exit, in which drivers crash while other threads use them.
#[cfg(unix)]
fn end_now() {
    use rustix::process::{Signal, getpid, kill_process};
    let _ = kill_process(getpid(), Signal::KILL);
}

/// Ends the program.
#[cfg(not(unix))]
fn end_now() {
    std::process::exit(i32::from(BASE + INTERRUPT));
}

/// Asks another process to end, as its user would. Elsewhere than on Unix a console's Ctrl-C reaches all its processes.
pub fn terminate(child: &std::process::Child) {
    #[cfg(unix)]
    {
        use rustix::process::{Pid, Signal, kill_process};
        // One that has just ended needs no signal.
        let _ = kill_process(Pid::from_child(child), Signal::TERM);
    }
    #[cfg(not(unix))]
    let _ = child;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_forgotten_signal_is_followed_by_another_first_one() {
        use signal_hook::consts::SIGTERM;
        use std::sync::mpsc::channel;
        let (told, stopped) = channel();
        on_stop(move || told.send(()).unwrap());
        for _ in 0..2 {
            signal_hook::low_level::raise(SIGTERM).unwrap();
            stopped.recv_timeout(Duration::from_secs(20)).expect("the signal stops the command");
            assert!(exit_code().is_some());
            forget();
            assert!(exit_code().is_none());
        }
    }

    #[test]
    fn codes_of_signals_are_those_of_shells() {
        assert!(is_stopped(Some(130)), "Ctrl-C");
        assert_eq!([129, 143].map(|code| is_stopped(Some(code))), [cfg!(unix); 2]);
        assert!([None, Some(0), Some(1), Some(2), Some(137)].into_iter().all(|code| !is_stopped(code)));
    }
}
