//! The child: opens the adapter that its parent names, tests it, and says the outcome.

use std::ffi::OsString;
use std::io::{self, Read, Write};
use std::thread;
use std::time::Duration;

#[cfg(doc)]
use super::Probe;
use super::outcome::{encode, over, say};
use crate::backend::WgpuBackend;
use crate::device::adapters::{Adapter, Adapters};
use crate::device::gpu::Gpu;
use crate::device::stopwatch::longest;
use crate::error::{GpuError, OpenError};
use crate::options::OpenOptions;
use crate::parity::Parity;

/// The work of the process that a [`Probe`] starts: opens and tests the adapter that the arguments
/// name, and writes the outcome to `out`, which is its standard output. The arguments are those
/// that follow [`Probe::arguments`]. The process must end then; if its parent ends earlier, the
/// process ends too.
///
/// # Errors
/// Arguments that are no probe's, or an output that nobody reads.
pub fn answer_probe(arguments: &[OsString], out: &mut dyn Write) -> io::Result<()> {
    let asked = Asked::parse(arguments).ok_or_else(|| {
        io::Error::new(io::ErrorKind::InvalidInput, "only a probe of splitplane's asks for this")
    })?;
    // It is open for as long as the parent waits.
    thread::Builder::new().spawn(|| {
        let _ = io::stdin().read_to_end(&mut Vec::new());
        std::process::exit(0);
    })?;
    out.write_all(asked.answer().as_bytes())?;
    out.flush()
}

/// What the parent asks.
#[derive(Debug, PartialEq, Eq)]
struct Asked {
    index: usize,
    name: String,
    time: Duration,
    memory: u64,
}

impl Asked {
    fn parse(arguments: &[OsString]) -> Option<Asked> {
        let [index, name, time, memory] = arguments else { return None };
        let number = |text: &OsString| text.to_str()?.parse::<u64>().ok();
        Some(Asked {
            index: usize::try_from(number(index)?).ok()?,
            name: name.to_str()?.to_owned(),
            time: Duration::from_millis(number(time)?),
            memory: number(memory)?,
        })
    }

    fn answer(&self) -> String {
        let adapters = Adapters::find();
        let list = adapters.list();
        let same = |adapter: &&Adapter| adapter.name() == self.name;
        let adapter = list.get(self.index).filter(same).or_else(|| list.iter().find(same));
        let Some(adapter) = adapter else {
            return say("failed", format_args!("no GPU adapter is called `{}`", self.name));
        };
        let options = OpenOptions {
            // The limit of time is the parent's to keep.
            timeout: Some(longest(self.time)),
            driver_time: Some(self.time),
            driver_memory: Some(self.memory),
            ..OpenOptions::default()
        };
        match adapter.open(&options) {
            Ok(gpu) => encode(tested(gpu)),
            Err(OpenError::DriverLimit { doing, limit, .. }) => over(&doing, limit),
            Err(OpenError::Unusable { reason, .. }) => say("failed", reason),
            Err(error) => say("failed", error),
        }
    }
}

/// What the self-test finds.
fn tested(gpu: Gpu) -> Result<Parity, GpuError> {
    let backend = WgpuBackend::new(gpu)?;
    Ok(backend.parity().cloned().expect("`new` has tested it"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_parent_asks_comes_across() {
        let asked = |arguments: &[&str]| {
            Asked::parse(&arguments.iter().map(OsString::from).collect::<Vec<_>>())
        };
        let time = Duration::from_secs(20);
        let full = Asked { index: 1, name: "a b".into(), time, memory: 7 };
        assert_eq!(asked(&["1", "a b", "20000", "7"]), Some(full));
        for wrong in [&["1", "a", "2"][..], &["", "a", "2", "3"], &["1", "a", "2", "-3"], &[]] {
            assert_eq!(asked(wrong), None, "{wrong:?}");
        }
    }
}
