//! Caches everything that a process reuses when it reads a package again. The key of most entries has all inputs of
//! the entry, such as a text and features, so Karat makes a new entry after an edit. There are three exceptions. The
//! entries for cargo's graphs stay until the process ends. For `karat.toml` and for linked programs, the code that
//! uses an entry first checks if the entry is still right. For outputs of `preprocess`, which may depend on any
//! file, [`refresh`] forgets the entries. If the entries of a kind reach the kind's limit, Karat drops all entries
//! of this kind.

use std::any::{Any, TypeId};
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

pub(crate) trait Kind: 'static {
    /// The type of the keys. A key has all inputs from which an entry is computed.
    type Key: Eq + Hash + Send + 'static;
    type Value: Send + 'static;
    /// The largest number of entries of this kind.
    const MOST: usize;
    /// `true` if an entry may depend on more than its key, so that [`refresh`] must forget the entry.
    const VOLATILE: bool = false;
}

type Entries<K> = HashMap<<K as Kind>::Key, <K as Kind>::Value>;

/// All entries of one kind. Each kind has its own lock, because cargo may take seconds to compute one entry.
struct Shelf {
    entries: Arc<Mutex<Box<dyn Any + Send>>>,
    clear: Option<fn(&mut (dyn Any + Send))>,
}

static WORKSPACE: LazyLock<Mutex<HashMap<TypeId, Shelf>>> = LazyLock::new(Mutex::default);

fn locked<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn entries<K: Kind>(any: &mut (dyn Any + Send)) -> &mut Entries<K> {
    any.downcast_mut().expect("the entries of each kind have their own Rust type")
}

/// Calls `work` with the locked entries of a kind. `work` must not use the same kind again.
pub(crate) fn with<K: Kind, T>(work: impl FnOnce(&mut Entries<K>) -> T) -> T {
    let shelf = {
        let mut workspace = locked(&WORKSPACE);
        let shelf = workspace.entry(TypeId::of::<K>()).or_insert_with(|| Shelf {
            entries: Arc::new(Mutex::new(Box::new(Entries::<K>::new()))),
            clear: K::VOLATILE.then_some(|any| entries::<K>(any).clear()),
        });
        Arc::clone(&shelf.entries)
    };
    let mut any = locked(&shelf);
    work(entries::<K>(&mut **any))
}

/// Calls `work` with the locked entries of a kind, after making room for another entry.
pub(crate) fn with_room<K: Kind, T>(work: impl FnOnce(&mut Entries<K>) -> T) -> T {
    with::<K, _>(|entries| {
        if entries.len() >= K::MOST {
            entries.clear();
        }
        work(entries)
    })
}

pub(crate) fn get<K: Kind<Value: Clone>>(key: &K::Key) -> Option<K::Value> {
    with::<K, _>(|entries| entries.get(key).cloned())
}

pub(crate) fn keep<K: Kind>(key: K::Key, value: K::Value) {
    with_room::<K, _>(|entries| drop(entries.insert(key, value)));
}

/// Forgets the outputs of `preprocess` programs (`karat.toml`), because such an output may depend on files that
/// Karat doesn't know. A process that lives through several edits, such as `karat watch`, calls this function before
/// it reads a package again.
///
/// ```
/// karat::unstable::workspace::refresh();
/// ```
pub fn refresh() {
    let shelves = |shelf: &Shelf| Some((Arc::clone(&shelf.entries), shelf.clear?));
    let volatile: Vec<_> = locked(&WORKSPACE).values().filter_map(shelves).collect();
    for (entries, clear) in volatile {
        clear(&mut **locked(&entries));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Lasting;
    impl Kind for Lasting {
        type Key = u32;
        type Value = &'static str;
        const MOST: usize = 2;
    }

    struct Passing;
    impl Kind for Passing {
        type Key = u32;
        type Value = &'static str;
        const MOST: usize = 2;
        const VOLATILE: bool = true;
    }

    #[test]
    fn a_refresh_clears_only_cached_values_that_may_be_stale() {
        keep::<Lasting>(1, "one");
        keep::<Passing>(1, "other");
        assert_eq!((get::<Lasting>(&1), get::<Passing>(&1)), (Some("one"), Some("other")));
        refresh();
        assert_eq!((get::<Lasting>(&1), get::<Passing>(&1)), (Some("one"), None));
        keep::<Lasting>(2, "two");
        assert_eq!((get::<Lasting>(&1), get::<Lasting>(&2)), (Some("one"), Some("two")), "all fit");
        keep::<Lasting>(3, "three");
        assert_eq!((get::<Lasting>(&1), get::<Lasting>(&3)), (None, Some("three")), "it was full");
    }
}
