//! Runs other programs: their output goes to a log, and they are ended when this program has to end.

use crate::signals::Stopped;
use anyhow::{Context, Result, bail};
use std::collections::VecDeque;
use std::ffi::OsString;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Interval between two checks whether to stop.
const PATIENCE: Duration = Duration::from_millis(100);

/// Lines at the end of what a program printed that an error shows.
const LAST_LINES: usize = 3;

/// A program of the system.
#[derive(Clone, Debug)]
pub struct Tool {
    program: PathBuf,
    /// How to install it.
    install: &'static str,
    log: PathBuf,
    stop: Arc<AtomicBool>,
}

impl Tool {
    /// `install` says how to get the program if it is missing. Its output is appended to the file `log`. It is ended
    /// once `stop` is true.
    pub fn new(program: PathBuf, install: &'static str, log: PathBuf, stop: Arc<AtomicBool>) -> Self {
        Self { program, install, log, stop }
    }

    /// Its file name, or the path given.
    pub fn name(&self) -> String {
        self.program.display().to_string()
    }

    /// Another program, by its name, that is run in the same way.
    pub fn other(&self, program: &str) -> Self {
        Self { program: program.into(), ..self.clone() }
    }

    /// All that a call prints: some programs print their help on standard error. Its exit status does not matter: old programs
    /// end their help with 1.
    ///
    /// # Errors
    /// The program is missing or cannot be run.
    pub fn output(&self, arguments: &[&str]) -> Result<String> {
        let output = Command::new(&self.program).args(arguments).stdin(Stdio::null()).output();
        let output = output.map_err(|error| self.missing(error))?;
        Ok(String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
    }

    /// Runs a call to its end; `each` sees every line that it prints.
    ///
    /// # Errors
    /// The program is missing, it fails, or it was ended by `stop`.
    pub fn run(&self, arguments: &[OsString], mut each: impl FnMut(&str)) -> Result<()> {
        let mut log = self.begin_log(arguments)?;
        let mut child = self.spawn(arguments)?;
        let (sender, lines) = channel();
        let readers = [
            child.stdout.take().map(|out| read_lines(out, sender.clone())),
            child.stderr.take().map(|out| read_lines(out, sender)),
        ];
        let mut last = VecDeque::new();
        while let Some(line) = self.next(&mut child, &lines)? {
            // The log is a help, and no reason to fail.
            let _ = writeln!(log, "{line}");
            each(&line);
            keep_last(&mut last, line);
        }
        join(readers);
        self.end(child, last.make_contiguous())
    }

    /// Runs a call that prints blocks of `size` bytes on standard output; `each` sees every one.
    ///
    /// # Errors
    /// As [`Tool::run`].
    pub fn blocks(&self, arguments: &[OsString], size: usize, mut each: impl FnMut(&[u8])) -> Result<()> {
        let mut log = self.begin_log(arguments)?;
        let mut child = self.spawn(arguments)?;
        let (sender, lines) = channel();
        let reader = child.stderr.take().map(|out| read_lines(out, sender));
        let mut out = child.stdout.take().context("the program has no output")?;
        let mut block = vec![0; size];
        loop {
            match out.read_exact(&mut block) {
                Ok(()) => each(&block),
                Err(error) if error.kind() == ErrorKind::UnexpectedEof => break,
                Err(error) => return Err(error).with_context(|| format!("cannot read from {}", self.name())),
            }
            self.check(&mut child)?;
        }
        let mut last = VecDeque::new();
        while let Some(line) = self.next(&mut child, &lines)? {
            let _ = writeln!(log, "{line}");
            keep_last(&mut last, line);
        }
        join([reader]);
        self.end(child, last.make_contiguous())
    }

    fn begin_log(&self, arguments: &[OsString]) -> Result<File> {
        let log = OpenOptions::new().create(true).append(true).open(&self.log);
        let mut log = log.with_context(|| format!("cannot write {}", self.log.display()))?;
        let words: Vec<_> = arguments.iter().map(|word| word.to_string_lossy()).collect();
        let _ = writeln!(log, "\n$ {} {}", self.name(), words.join(" "));
        Ok(log)
    }

    fn spawn(&self, arguments: &[OsString]) -> Result<Child> {
        let mut command = Command::new(&self.program);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command.spawn().map_err(|error| self.missing(error))
    }

    fn missing(&self, error: std::io::Error) -> anyhow::Error {
        let error = match error.kind() {
            ErrorKind::NotFound => format!("{} was not found", self.name()),
            _ => format!("cannot run {}: {error}", self.name()),
        };
        anyhow::anyhow!("{error}; {}", self.install)
    }

    /// The next line; none at the end.
    fn next(&self, child: &mut Child, lines: &Receiver<String>) -> Result<Option<String>> {
        loop {
            self.check(child)?;
            match lines.recv_timeout(PATIENCE) {
                Ok(line) => return Ok(Some(line)),
                Err(RecvTimeoutError::Disconnected) => return Ok(None),
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    fn check(&self, child: &mut Child) -> Result<()> {
        if self.stop.load(Ordering::Relaxed) {
            let _ = child.kill();
            let _ = child.wait();
            bail!(Stopped("stopped; the same command continues from here"));
        }
        Ok(())
    }

    fn end(&self, mut child: Child, last: &[String]) -> Result<()> {
        let status = child.wait().with_context(|| format!("cannot wait for {}", self.name()))?;
        if status.success() {
            return Ok(());
        }
        // It gets the same signal from the terminal as we do.
        self.check(&mut child)?;
        let words =
            if last.is_empty() { "it says nothing".to_owned() } else { format!("it says `{}`", last.join(" / ")) };
        bail!("{} failed ({status}): {words}; everything it printed is in {}", self.name(), self.log.display())
    }
}

fn read_lines(out: impl Read + Send + 'static, lines: Sender<String>) -> JoinHandle<()> {
    thread::spawn(move || {
        let mut reader = BufReader::new(out);
        let mut line = Vec::new();
        while reader.read_until(b'\n', &mut line).is_ok_and(|length| length > 0) {
            // Not every program prints UTF-8, and paths need not be.
            if lines.send(String::from_utf8_lossy(&line).trim_end().to_owned()).is_err() {
                break;
            }
            line.clear();
        }
    })
}

fn join<const N: usize>(readers: [Option<JoinHandle<()>>; N]) {
    for reader in readers.into_iter().flatten() {
        let _ = reader.join();
    }
}

fn keep_last(last: &mut VecDeque<String>, line: String) {
    if !line.trim().is_empty() {
        last.push_back(line.trim().to_owned());
    }
    if last.len() > LAST_LINES {
        last.pop_front();
    }
}

/// Arguments of several types as one array.
#[macro_export]
macro_rules! arguments {
    ($($argument:expr),* $(,)?) => { [$(std::ffi::OsString::from($argument)),*] };
}
