//! Keeps panics inside: a decoder's, and those of threads that read.

use std::{
    any::Any,
    cell::Cell,
    panic::{self, AssertUnwindSafe},
    sync::Once,
};

thread_local! {
    static CONTAINED: Cell<bool> = const { Cell::new(false) };
}

/// Runs `decode`; a panic inside becomes its message, and nothing is printed. What `decode` borrowed
/// mutably is to be dropped after a panic.
pub(super) fn contain<T>(decode: impl FnOnce() -> T) -> Result<T, String> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let print = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !CONTAINED.get() {
                print(info);
            }
        }));
    });
    let outer = CONTAINED.replace(true);
    let result = panic::catch_unwind(AssertUnwindSafe(decode));
    CONTAINED.set(outer);
    result.map_err(|payload| format!("the decoder gave up: {}", message(payload.as_ref())))
}

/// Runs `work`; a panic inside becomes its message, and is printed as any other: it is a fault of this program. What
/// `work` borrowed mutably is to be dropped after a panic, or to be sound whatever was done of it.
pub(crate) fn caught<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    panic::catch_unwind(AssertUnwindSafe(work)).map_err(|payload| message(payload.as_ref()).to_owned())
}

fn message(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("no reason given")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_its_message() {
        assert_eq!(contain(|| 7), Ok(7));
        let index = 5;
        let error = contain(|| [1, 2, 3][std::hint::black_box(index)]).unwrap_err();
        assert!(error.contains("index out of bounds"), "{error}");
        assert!(!CONTAINED.get());
    }
}
