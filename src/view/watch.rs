//! Looks after the files of a window: which of them have changed, are gone, or are there again. By asking for their
//! lengths and times now and then, since network drives tell nobody of changes.

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// Between two looks at all files, at least.
const PERIOD: Duration = Duration::from_secs(1);
/// And as many times as long as a look took, up to the second.
const REST: u32 = 20;
const MOST_REST: Duration = Duration::from_secs(30);

/// Length and time of the last change; `None`: it is not there.
pub type Stamp = Option<(u64, Option<SystemTime>)>;

/// What a file looks like now.
pub fn stamp(path: &Path) -> Stamp {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.len(), metadata.modified().ok()))
}

/// A file that is not what it was.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct News {
    /// The number that it was given.
    pub file: usize,
    /// It can be opened again; else it is gone.
    pub is_there: bool,
}

struct Watched {
    file: usize,
    path: PathBuf,
    /// As was last said.
    known: Stamp,
    /// As it was seen last.
    seen: Stamp,
    /// It was not there once since: what was read meanwhile may lack it.
    was_away: bool,
}

/// A thread that looks. Dropped, it ends.
pub struct Watch {
    add: Sender<Watched>,
    news: Receiver<News>,
}

impl Watch {
    /// `wake` is called when there is news.
    pub fn new(wake: impl Fn() + Send + 'static) -> Watch {
        let (add, added) = crossbeam_channel::unbounded();
        let (tell, news) = crossbeam_channel::unbounded();
        std::thread::spawn(move || look(&added, &tell, &wake));
        Watch { add, news }
    }

    /// Watches a file that looked like `known` when it was opened, under a number of the caller's.
    pub fn add(&self, file: usize, path: PathBuf, known: Stamp) {
        // The thread lives as long as this does.
        let _ = self.add.send(Watched { file, path, known, seen: known, was_away: false });
    }

    /// What has happened.
    pub fn news(&self) -> impl Iterator<Item = News> {
        self.news.try_iter()
    }
}

fn look(added: &Receiver<Watched>, tell: &Sender<News>, wake: &dyn Fn()) {
    let mut watched: Vec<Watched> = Vec::new();
    let mut rest = PERIOD;
    loop {
        let next = Instant::now() + rest;
        loop {
            match added.recv_deadline(next) {
                Ok(file) => watched.push(file),
                Err(RecvTimeoutError::Timeout) => break,
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
        let start = Instant::now();
        for file in &mut watched {
            let now = stamp(&file.path);
            // What is still being written is let alone until it looks the same twice.
            file.was_away |= now.is_none();
            let is_news = now != file.known || file.was_away && now.is_some();
            if now == std::mem::replace(&mut file.seen, now) && is_news {
                file.known = now;
                file.was_away = false;
                if tell.send(News { file: file.file, is_there: now.is_some() }).is_err() {
                    return;
                }
                wake();
            }
        }
        rest = (start.elapsed() * REST).clamp(PERIOD, MOST_REST);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_told_once_they_are_over() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a.las", "b.las"].map(|name| folder.path().join(name));
        for path in [&a, &b] {
            std::fs::write(path, [0; 10]).unwrap();
        }
        let watch = Watch::new(|| ());
        watch.add(7, a.clone(), stamp(&a));
        // As it was before somebody wrote to it.
        watch.add(8, b.clone(), Some((9, None)));
        let news = || watch.news.recv_timeout(Duration::from_secs(20)).unwrap();
        assert_eq!(news(), News { file: 8, is_there: true });
        std::fs::remove_file(&a).unwrap();
        assert_eq!(news(), News { file: 7, is_there: false });
        std::fs::write(&a, [1; 10]).unwrap();
        assert_eq!(news(), News { file: 7, is_there: true });
        assert!(watch.news.recv_timeout(3 * PERIOD).is_err());
    }
}
