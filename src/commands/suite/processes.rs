//! The running processes of a suite, which end with it.

use crate::signals::terminate;
use std::io;
use std::process::{Child, Command, ExitStatus};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Interval between two checks whether a process has ended; processes take minutes.
const LOOK: Duration = Duration::from_millis(50);

/// Starts processes and waits for them, from several threads.
#[derive(Default)]
pub struct Processes(Mutex<Children>);

#[derive(Default)]
struct Children {
    is_closed: bool,
    running: Vec<Child>,
}

impl Processes {
    fn state(&self) -> MutexGuard<'_, Children> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs a command to its end; none if nothing may start any more.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn run(&self, command: &mut Command) -> io::Result<Option<ExitStatus>> {
        let id = {
            let mut state = self.state();
            if state.is_closed {
                return Ok(None);
            }
            // Under the lock: either it gets the signal, or it is not started.
            let child = command.spawn()?;
            let id = child.id();
            state.running.push(child);
            id
        };
        loop {
            std::thread::sleep(LOOK);
            let mut state = self.state();
            // Its number is its own until it is waited for, and that is done under the lock.
            let at = state.running.iter().position(|child| child.id() == id).expect("only this call removes it");
            if state.running[at].try_wait()?.is_some() {
                return state.running.swap_remove(at).wait().map(Some);
            }
        }
    }

    /// Lets nothing more start.
    pub fn close(&self) {
        self.state().is_closed = true;
    }

    /// Whether nothing may start any more.
    pub fn is_closed(&self) -> bool {
        self.state().is_closed
    }

    /// Starts no more processes, and asks the running ones to end.
    pub fn terminate(&self) {
        let mut state = self.state();
        state.is_closed = true;
        state.running.iter().for_each(terminate);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::process::ExitStatusExt;
    use std::time::Instant;

    #[test]
    fn what_runs_ends_and_nothing_starts() {
        let processes = Processes::default();
        let quick = processes.run(Command::new("sh").args(["-c", "exit 7"])).unwrap();
        assert_eq!(quick.and_then(|status| status.code()), Some(7));
        let begun = Instant::now();
        let ended = std::thread::scope(|scope| {
            let sleeper = scope.spawn(|| processes.run(Command::new("sleep").arg("60")));
            while processes.state().running.is_empty() {
                std::thread::sleep(Duration::from_millis(5));
            }
            processes.terminate();
            sleeper.join().unwrap().unwrap()
        });
        assert_eq!(ended.and_then(|status| status.signal()), Some(15));
        assert!(begun.elapsed() < Duration::from_secs(50));
        assert!(processes.is_closed() && processes.run(&mut Command::new("true")).unwrap().is_none());
    }
}
