//! The system's wish that the program ends: Ctrl-C, and on Unix SIGTERM, by which `timeout` and batch systems end programs.
//! A hangup is left to the system, so that `nohup` keeps a program running.

use anyhow::Context;

/// Calls `then` on a thread of its own whenever the program is asked to end; once in a process.
///
/// # Errors
/// The system refuses to tell.
pub fn on_request(mut then: impl FnMut() + Send + 'static) -> anyhow::Result<()> {
    #[cfg(unix)]
    {
        use signal_hook::consts::{SIGINT, SIGTERM};
        let signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM]);
        let mut signals = signals.context("cannot listen for Ctrl-C")?;
        let listen = move || signals.forever().for_each(|_| then());
        std::thread::Builder::new()
            .name("signals".to_owned())
            .spawn(listen)
            .context("cannot listen for Ctrl-C")?;
        Ok(())
    }
    #[cfg(not(unix))]
    ctrlc::set_handler(move || then()).context("cannot listen for Ctrl-C")
}
