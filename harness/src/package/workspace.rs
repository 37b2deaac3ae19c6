//! The owner of all that a process keeps between one look at a package and the next. An entry of most kinds is found
//! by all that it was made of, such as a text and features, so an edit finds none. Other kinds say beside them what the
//! next process alone sees (cargo's graphs), or check what they find (programs, `karat.toml`). A kind that reaches its
//! bound is forgotten whole, and [`refresh`] forgets what may depend on files that Karat knows nothing of.

use std::any::{Any, TypeId};
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

/// A kind of entries.
pub(crate) trait Kind: 'static {
    /// All that an entry is made of.
    type Key: Eq + Hash + Send + 'static;
    type Value: Send + 'static;
    /// How many are kept.
    const MOST: usize;
    /// True if entries have causes that aren't in their keys.
    const VOLATILE: bool = false;
}

type Entries<K> = HashMap<<K as Kind>::Key, <K as Kind>::Value>;

/// The entries of a kind. Kinds have locks of their own: cargo may take seconds to answer.
struct Shelf {
    entries: Arc<Mutex<Box<dyn Any + Send>>>,
    clear: Option<fn(&mut (dyn Any + Send))>,
}

static WORKSPACE: LazyLock<Mutex<HashMap<TypeId, Shelf>>> = LazyLock::new(Mutex::default);

fn locked<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn entries<K: Kind>(any: &mut (dyn Any + Send)) -> &mut Entries<K> {
    any.downcast_mut().expect("a kind has entries of its own type")
}

/// Works on the entries of a kind, which others wait for. `work` must not come back for the same kind.
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

/// The entries of a kind, with room for another one.
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

/// Forgets what was kept of files that Karat knows nothing of: what a program printed (`preprocess` in
/// `karat.toml`) may depend on any. A process that lives on between edits calls it before each look.
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
    fn kinds_are_apart_and_only_what_may_be_stale_is_forgotten() {
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
