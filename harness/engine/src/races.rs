//! Finds races. In a race, two invocations access one element, at least one of them writes, and nothing orders the two
//! accesses.
//!
//! WGSL orders few accesses (15.4 *Memory model*, 17.11 *Synchronization built-in functions*). A barrier orders the
//! accesses of one workgroup to one address space: `workgroupBarrier` orders the accesses to workgroup memory, and
//! `storageBarrier` orders the accesses to storage buffers. Nothing orders two workgroups of a dispatch. Atomic
//! accesses don't race with each other, and WGSL has no other way to access an atomic.
//!
//! The engine runs invocations in lockstep, so a race doesn't change the results. The detector therefore stores, for
//! each element, the accesses with which a later access could race:
//!
//! - the last write, and the last write by an invocation other than the last writer. So whichever invocation makes the
//!   later access, the detector has a write by another invocation, if there was one;
//! - the last write by an earlier workgroup;
//! - the last write of a value that differs from the last written value, to distinguish equal writes from unequal
//!   writes;
//! - two reads by different invocations since the last barrier, and one read by an earlier workgroup.

use std::collections::{BTreeMap, HashMap, HashSet};

use naga::Barrier;

use crate::code::{Binding, Code, Site};
use crate::dispatch::Turn;
use crate::explore::{Access as Touch, Word};
use crate::refusal::Stop;

/// The size of a page in bytes or texels. The detector allocates memory for its notes on elements page by page, because
/// a dispatch may access only a small part of a buffer.
const PAGE: usize = 1024;

/// The largest number of elements whose accesses the detector stores. Each element needs 116 bytes, so all need 116
/// MiB. For all other elements, the detector only counts the accesses.
const MOST_CELLS: usize = 1 << 20;
const _: () = assert!(size_of::<Cell>() == 116);

/// The largest number of races that the detector keeps for a variable. Each of these races has a different pair of
/// source lines. This limit applies separately to races of equal writes (both accesses write the same word) and to all
/// other races. A loop over a buffer may have a race for each element, all between the same two lines.
const MOST_RACES: usize = 64;

const NONE: u32 = u32::MAX;

/// The position of an element in its variable. An element is a scalar or a texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The offset in bytes from the beginning of the variable.
    Byte(u32),
    /// The coordinates of the texel.
    Texel([u32; 3]),
}

/// An access to an element.
#[derive(Clone, Debug)]
pub struct Access {
    /// The site of the access in the source.
    pub site: Site,
    /// The number of the invocation in the dispatch. Invocations are numbered workgroup after workgroup, and in each
    /// workgroup by `local_invocation_index`.
    pub invocation: usize,
    /// `true` for a write, `false` for a read.
    pub writes: bool,
    /// The word that the access writes or reads. For a texel, a hash of its four channels.
    pub word: u32,
    /// For a texel, its four channels, if the detector kept them. Otherwise `None`.
    pub texel: Option<[u32; 4]>,
}

/// Two unordered accesses to one element.
#[derive(Clone, Debug)]
pub struct Race {
    /// The name of the variable in the module.
    pub variable: String,
    /// The group and binding of the variable. `None` for workgroup memory.
    pub binding: Option<(u32, u32)>,
    /// The element.
    pub place: Place,
    /// The access that the engine ran first.
    pub first: Access,
    /// The other access.
    pub second: Access,
    /// `true` if both invocations are in one workgroup. A barrier could then order the two accesses.
    pub one_workgroup: bool,
    /// The number of elements on which the same two lines of the source race.
    pub elements: u64,
}

impl Race {
    /// Checks if both accesses write, and write the same word.
    #[must_use]
    pub fn writes_equally(&self) -> bool {
        self.first.writes && self.second.writes && self.first.word == self.second.word
    }
}

/// A barrier that only some invocations of a workgroup reached together, or an operation that only some invocations of
/// a subgroup reached together.
#[derive(Clone, Debug)]
pub struct Divergence {
    /// The barrier or the operation.
    pub site: Site,
    /// An invocation that reached the barrier or the operation.
    pub reached: usize,
    /// The first invocation that didn't reach the barrier or the operation.
    pub missing: usize,
    /// The number of invocations that didn't reach the barrier or the operation.
    pub count: usize,
    /// `true` for a subgroup operation.
    pub subgroup: bool,
    /// The condition or the jump at which the missing invocation took another branch. `None` if the engine doesn't know
    /// this site, for example because the invocations don't run side by side.
    pub parted: Option<Site>,
}

/// Reads of elements that no invocation has written. The elements are in workgroup memory, which WGSL initializes to
/// zero, or in a blank buffer: a buffer with unknown contents.
#[derive(Clone, Debug)]
pub struct Unwritten {
    /// The first read of an unwritten element by one operation of the shader.
    pub access: Access,
    /// The name of the variable in the module.
    pub variable: String,
    /// `true` for workgroup memory.
    pub own: bool,
    /// The offset of the first unwritten element that is read, in bytes from the beginning of the variable.
    pub byte: u32,
    /// The number of reads of unwritten elements by the operation of `access`.
    pub count: u64,
}

/// The kind of object that an index is outside of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Bounds {
    /// An array with a fixed length.
    Fixed,
    /// A runtime-sized array.
    Runtime,
    /// A texture.
    Texture,
    /// A subgroup. The subgroup has no invocation with this index, or the invocation isn't active.
    Subgroup,
    /// No object: the index is inside of the array, but only because a sum or a product has wrapped around.
    Wrapped,
}

/// An operation with indices outside of its array.
#[derive(Clone, Debug)]
pub struct Outside {
    /// The operation.
    pub site: Site,
    /// The first invocation whose index is outside of the array.
    pub invocation: usize,
    /// The number of indices outside of the array, over all invocations.
    pub count: u64,
    /// `true` for a write or an atomic.
    pub writes: bool,
    /// The kind of object that the indices are outside of.
    pub bounds: Bounds,
    /// The texture, or the buffer or workgroup variable that contains the array. `None` for a function variable or a
    /// private variable.
    pub variable: Option<String>,
    /// `true` if the array is inside another array or a structure.
    pub nested: bool,
    /// If the array is in a buffer: the index in the first invocation, and the number of elements. For an index that
    /// wraps around: the index without wrapping, and the index with wrapping.
    pub index: Option<(i64, u64)>,
    /// The number of times that the operation ran.
    pub of: u64,
    /// The number of the operation for [`Options::outside_at`](crate::Options::outside_at).
    pub number: u32,
}

#[derive(Clone, Copy)]
pub(crate) struct Beyond<'c> {
    pub(crate) writes: bool,
    pub(crate) bounds: Bounds,
    pub(crate) variable: Option<&'c str>,
    pub(crate) nested: bool,
    pub(crate) index: Option<(i64, u64)>,
}

/// The findings of a dispatch.
#[derive(Clone, Debug, Default)]
pub struct Observed {
    /// The first race of each pair of source lines. Races of equal writes come after all other races.
    pub races: Vec<Race>,
    /// The barriers that only some invocations reached. Each barrier occurs once.
    pub divergences: Vec<Divergence>,
    /// The operations with indices outside of their arrays or textures. Each operation occurs once.
    pub outside: Vec<Outside>,
    /// The reads of elements that no invocation has written, in workgroup memory and in buffers with unknown contents.
    /// Each site occurs once.
    pub unwritten: Vec<Unwritten>,
    /// For each storage buffer or storage texture, by group and binding: the words or texels that the program wrote.
    pub written: BTreeMap<(u32, u32), Touched>,
    /// The reason why the dispatch ended early.
    pub stopped: Option<Stop>,
    /// The number of invocations that ran.
    pub invocations: usize,
    /// The number of iterations of all loops in all invocations.
    pub rounds: u64,
    /// The number of turns of all invocations. In a turn, an invocation runs to its next atomic or barrier.
    pub turns: u64,
    /// The atomics of the dispatch.
    pub atomics: Atomics,
    /// The order in which the atomics ran, if [`Options::shows_order`](crate::Options::shows_order) requests it.
    pub order: Vec<Turn>,
    /// The number of accesses that aren't checked for races, because the detector stores the accesses of only a limited
    /// number of elements.
    pub unwatched: u64,
}

/// Counts the atomics of a dispatch, to estimate in how many orders they can run.
#[derive(Clone, Debug, Default)]
pub struct Atomics {
    /// The number of atomics of each invocation.
    pub of_invocation: Vec<u32>,
    /// For each word: the kinds of its atomics, as bits, and the number of its atomics by invocation.
    words: HashMap<Word, (u32, BTreeMap<usize, u32>)>,
    count: usize,
}

impl Atomics {
    /// The largest number of atomics for which orders are counted. A larger number of atomics has too many orders to
    /// try.
    const COUNTED: usize = 1 << 12;

    fn add(&mut self, invocation: usize, word: Word, kind: Touch) {
        if self.of_invocation.len() <= invocation {
            self.of_invocation.resize(invocation + 1, 0);
        }
        self.of_invocation[invocation] += 1;
        self.count += 1;
        let (kinds, counts) = self.words.entry(word).or_default();
        *kinds |= 1 << kind as u32;
        if self.count <= Self::COUNTED {
            *counts.entry(invocation).or_default() += 1;
        }
    }

    /// An upper bound of the number of orders in which the atomics can run, as a binary logarithm. Equivalent orders
    /// count as one order. The bound is the product of the numbers of orders for each word, as if words were
    /// independent.
    #[must_use]
    pub fn most_orders(&self) -> f64 {
        let commute = |kinds: u32| kinds.count_ones() == 1 && kinds != 1 << Touch::Changes as u32;
        let log_factorial = |n: u32| (1..=n).map(|k| f64::from(k).log2()).sum::<f64>();
        let of_word = |counts: &BTreeMap<usize, u32>| {
            let all = log_factorial(counts.values().sum());
            all - counts.values().copied().map(log_factorial).sum::<f64>()
        };
        let mut left = self.words.values().filter(|(kinds, _)| !commute(*kinds)).peekable();
        if self.count > Self::COUNTED && left.peek().is_some() {
            return f64::INFINITY;
        }
        left.map(|(_, counts)| of_word(counts)).sum()
    }
}

/// An earlier access to an element. `epoch` is the number of barriers for the element's address space that the
/// workgroup had passed at the time of the access.
#[derive(Clone, Copy, Debug)]
struct Who {
    invocation: u32,
    epoch: u32,
    site: u32,
    word: u32,
}

const NONE_YET: Who = Who { invocation: NONE, epoch: 0, site: 0, word: 0 };

#[derive(Clone, Copy, Debug)]
struct Cell {
    write: Who,
    /// The last write by an invocation other than the invocation of `write`.
    other: Who,
    /// The last write of a word that differs from the word of `write`.
    unequal: Who,
    /// The last write by a workgroup that ran before the workgroup of `write`.
    earlier_write: Who,
    /// Reads by two invocations since the last barrier.
    reads: [Who; 2],
    earlier_read: Who,
    /// The number of `reads` that came after the last write, and didn't race with a write.
    clean: u8,
}

const EMPTY: Cell = Cell {
    write: NONE_YET,
    other: NONE_YET,
    unequal: NONE_YET,
    earlier_write: NONE_YET,
    reads: [NONE_YET; 2],
    earlier_read: NONE_YET,
    clean: 0,
};

/// A set of elements of a variable. Elements are numbered by their offset in bytes, texels row by row.
#[derive(Clone, Debug, Default)]
pub struct Touched(Vec<u64>);

impl Touched {
    /// Checks if the set has the element at this offset, or the texel with this number.
    #[must_use]
    pub fn contains(&self, at: usize) -> bool {
        self.0.get(at / 64).is_some_and(|bits| bits >> (at % 64) & 1 == 1)
    }

    fn add(&mut self, at: usize) {
        if self.0.len() <= at / 64 {
            self.0.resize(at / 64 + 1, 0);
        }
        self.0[at / 64] |= 1 << (at % 64);
    }
}

#[derive(Debug, Default)]
struct Shadow {
    written: bool,
    own: bool,
    /// `true` for a buffer whose contents are unknown until they are written.
    blank: bool,
    /// The number of words of a variable in workgroup memory. Each workgroup has its own copy of these words.
    words: usize,
    /// The cells of the elements, grouped by the byte of a word at which an element begins. Most elements begin at the
    /// first byte, but 16-bit floats may also begin at the third byte, and booleans at any byte.
    pages: [Vec<Option<Box<[Cell]>>>; 4],
    /// The written elements. In workgroup memory, these are the elements that this workgroup wrote. In buffers with
    /// unknown contents, they include the elements that earlier passes wrote.
    touched: Touched,
}

#[derive(Debug, Default)]
pub(crate) struct OfGroup {
    first: u32,
    epochs: [u32; 3],
    waiting: [bool; 3],
    own: Vec<Shadow>,
}

/// The variable of a race, `true` if it is a race of equal writes, both sites, and `true` if both accesses are in one
/// workgroup.
type Key = (u32, bool, (u32, u32), bool);

#[derive(Debug)]
pub(crate) struct Detector {
    width: u32,
    /// The number of the first invocation of each workgroup that has run. Workgroups that the caller excludes are
    /// missing.
    starts: Vec<usize>,
    /// The number of the current workgroup's first invocation, counting only the invocations of workgroups that run.
    first: u32,
    /// The numbers of barriers that the workgroup has passed: barriers for workgroup memory, for storage, and for
    /// textures.
    epochs: [u32; 3],
    /// The first of the lanes that are running, as a lane number within the workgroup.
    base: u32,
    /// For each kind of barrier in `epochs`, `true` if invocations wait at such a barrier.
    waiting: [bool; 3],
    buffers: Vec<Shadow>,
    textures: Vec<Shadow>,
    cells: usize,
    unwatched: u64,
    races: BTreeMap<Key, (Race, HashSet<(usize, usize)>)>,
    divergences: BTreeMap<u32, Divergence>,
    outside: BTreeMap<u32, Outside>,
    unwritten: BTreeMap<u32, Unwritten>,
    texels: HashMap<u32, [u32; 4]>,
    /// For each site of an operation with an index, the number of times that the operation ran.
    ran: Vec<u64>,
    atomics: Atomics,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Accessed {
    pub(crate) lane: usize,
    pub(crate) site: u32,
    pub(crate) place: Place,
    /// For a buffer, the number of the word in which the element begins. For a texture, the number of the texel.
    pub(crate) index: usize,
    pub(crate) word: u32,
}

impl Detector {
    /// Makes a detector for workgroups with `invocations` invocations. `blank` has the written elements of each buffer
    /// with unknown contents.
    pub(crate) fn new(
        code: &Code,
        invocations: usize,
        blank: &BTreeMap<(u32, u32), Touched>,
    ) -> Self {
        let shadow = |written: bool, own: bool| Shadow { written, own, ..Shadow::default() };
        let buffers = code.buffers.iter().map(|slot| {
            let own = match slot.binding {
                Binding::Resource { group, binding } => blank.get(&(group, binding)),
                Binding::Workgroup => None,
            };
            let touched = own.cloned().unwrap_or_default();
            let (blank, is_own) = (own.is_some(), slot.binding == Binding::Workgroup);
            let words = slot.workgroup_bytes().div_ceil(4) as usize;
            Shadow { blank, touched, words, ..shadow(slot.written, is_own) }
        });
        let textures = code.textures.iter().map(|slot| shadow(slot.written, false));
        Self {
            width: invocations as u32,
            starts: Vec::new(),
            first: 0,
            epochs: [0; 3],
            base: 0,
            waiting: [false; 3],
            buffers: buffers.collect(),
            textures: textures.collect(),
            cells: 0,
            unwatched: 0,
            races: BTreeMap::new(),
            divergences: BTreeMap::new(),
            outside: BTreeMap::new(),
            unwritten: BTreeMap::new(),
            texels: HashMap::new(),
            ran: vec![0; code.sites.len()],
            atomics: Atomics::default(),
        }
    }

    pub(crate) fn run(&mut self, site: u32, lanes: usize) {
        self.ran[site as usize] += lanes as u64;
    }

    /// Begins the workgroup whose first invocation is `first`.
    pub(crate) fn begin(&mut self, first: usize) {
        self.first = self.starts.len() as u32 * self.width;
        self.starts.push(first);
        (self.epochs, self.waiting) = ([0; 3], [false; 3]);
        for shadow in self.buffers.iter_mut().filter(|shadow| shadow.own) {
            shadow.touched.0.fill(0);
            shadow.pages.iter_mut().flatten().flatten().for_each(|page| page.fill(EMPTY));
        }
    }

    /// Swaps the state of the current workgroup for the stored state of another workgroup (`of`), which then continues.
    pub(crate) fn exchange(&mut self, of: &mut OfGroup) {
        std::mem::swap(&mut self.first, &mut of.first);
        std::mem::swap(&mut self.epochs, &mut of.epochs);
        std::mem::swap(&mut self.waiting, &mut of.waiting);
        let own = self.buffers.iter_mut().filter(|shadow| shadow.own);
        for (number, shadow) in own.enumerate() {
            if of.own.len() == number {
                let (written, words) = (shadow.written, shadow.words);
                of.own.push(Shadow { written, own: true, words, ..Shadow::default() });
            }
            std::mem::swap(shadow, &mut of.own[number]);
        }
    }

    /// Converts the number of an invocation, counted among the invocations that run, to its number in the whole
    /// dispatch.
    fn invocation(&self, number: u32) -> usize {
        let (group, lane) = (number / self.width, number % self.width);
        self.starts[group as usize] + lane as usize
    }

    fn of_lane(&self, lane: usize) -> usize {
        self.invocation(self.first + self.base + lane as u32)
    }

    /// Tells the detector that the lanes that run next begin at lane `base` of the workgroup.
    pub(crate) fn goes_on(&mut self, base: usize) {
        self.base = base as u32;
    }

    /// Records that the waiting invocations pass their barriers. No other invocation of the workgroup is still running.
    /// A unit is a group of `lanes` invocations that run side by side. `held` has the first invocation of each waiting
    /// unit, with the site of its barrier.
    pub(crate) fn release(&mut self, code: &Code, held: &[(usize, u32)], lanes: usize) {
        for (epoch, waiting) in self.epochs.iter_mut().zip(&mut self.waiting) {
            *epoch += u32::from(std::mem::take(waiting));
        }
        let Some(&(reached, site)) = held.iter().min() else { return };
        let is_here = |lane: usize| held.contains(&(lane, site));
        let missing = (0..self.width as usize).step_by(lanes).filter(|lane| !is_here(*lane));
        let missing: Vec<usize> = missing.collect();
        let Some(first) = missing.first() else { return };
        let [reached, one] =
            [reached, *first].map(|lane| self.invocation(self.first + lane as u32));
        self.divergences.entry(site).or_insert_with(|| Divergence {
            site: code.sites[site as usize].clone(),
            reached,
            missing: one,
            count: missing.len() * lanes,
            subgroup: false,
            parted: None,
        });
    }

    /// Checks if accesses to a buffer can race, or can read unwritten elements.
    pub(crate) fn watches_buffer(&self, slot: u32) -> bool {
        let Shadow { written, own, blank, .. } = self.buffers[slot as usize];
        written || own || blank
    }

    pub(crate) fn watches_texture(&self, slot: u32) -> bool {
        self.textures[slot as usize].written
    }

    /// Notes a barrier that the `active` invocations reach. `parted` has the sites at which the other invocations took
    /// another branch.
    pub(crate) fn barrier(
        &mut self,
        code: &Code,
        site: u32,
        barrier: Barrier,
        (parted, active): (&[Option<u32>], impl Iterator<Item = bool> + Clone),
    ) {
        let spaces = [Barrier::WORK_GROUP, Barrier::STORAGE, Barrier::TEXTURE];
        for (waiting, space) in self.waiting.iter_mut().zip(spaces) {
            *waiting |= barrier.contains(space);
        }
        self.meet(code, site, (0, false), (parted, active));
    }

    /// Notes an operation that all lanes of a group should reach together. The group is a workgroup, or a subgroup if
    /// `subgroup` is `true`. Its first lane is `first`. `active` marks the lanes that reach the operation, and `parted`
    /// has the sites at which the other lanes took another branch.
    pub(crate) fn meet(
        &mut self,
        code: &Code,
        site: u32,
        (first, subgroup): (usize, bool),
        (parted, active): (&[Option<u32>], impl Iterator<Item = bool> + Clone),
    ) {
        let missing = || active.clone().enumerate().filter(|(_, active)| !active);
        if let (Some((lane, _)), Some(here)) = (missing().next(), active.clone().position(|a| a)) {
            let parted = parted[first + lane];
            let [reached, missing_one] = [here, lane].map(|lane| self.of_lane(first + lane));
            self.divergences.entry(site).or_insert_with(|| Divergence {
                site: code.sites[site as usize].clone(),
                reached,
                missing: missing_one,
                count: missing().count(),
                subgroup,
                parted: parted.map(|site| code.sites[site as usize].clone()),
            });
        }
    }

    /// Notes that an access reads an element of a buffer, writes it, or both. The access may be atomic.
    #[inline]
    pub(crate) fn touch(
        &mut self,
        code: &Code,
        slot: u32,
        accessed: Accessed,
        (reads, writes): (bool, bool),
    ) {
        let Accessed { lane, site, place: Place::Byte(byte), word, .. } = accessed else { return };
        let is_blank = |shadow: &Shadow| {
            (shadow.own || shadow.blank) && !shadow.touched.contains(byte as usize)
        };
        if reads && is_blank(&self.buffers[slot as usize]) {
            let invocation = self.of_lane(lane);
            let shadow = &self.buffers[slot as usize];
            let site_of = || code.sites[site as usize].clone();
            let new = || Unwritten {
                access: Access { site: site_of(), invocation, writes: false, word, texel: None },
                variable: code.buffers[slot as usize].name.clone(),
                own: shadow.own,
                byte,
                count: 0,
            };
            self.unwritten.entry(site).or_insert_with(new).count += 1;
        }
        if writes {
            self.buffers[slot as usize].touched.add(byte as usize);
        }
    }

    pub(crate) fn atomic(&mut self, lane: usize, (slot, at): (u32, usize), kind: Touch) {
        let group = if self.buffers[slot as usize].own { self.first + 1 } else { 0 };
        self.atomics.add(self.of_lane(lane), (slot, group, at as u32), kind);
    }

    pub(crate) fn leaves(&mut self, code: &Code, site: u32, lane: usize, beyond: Beyond<'_>) {
        let Beyond { writes, bounds, variable, nested, index } = beyond;
        let invocation = self.of_lane(lane);
        let new = || Outside {
            site: code.sites[site as usize].clone(),
            invocation,
            count: 0,
            writes,
            bounds,
            variable: variable.map(str::to_owned),
            nested,
            index,
            of: 0,
            number: site,
        };
        self.outside.entry(site).or_insert_with(new).count += 1;
    }

    /// Notes a read or a write of a buffer's element. Returns `true` if the current workgroup made the last write to
    /// the element.
    #[inline]
    pub(crate) fn buffer(
        &mut self,
        code: &Code,
        slot: u32,
        accessed: Accessed,
        writes: bool,
    ) -> bool {
        let space = usize::from(!self.buffers[slot as usize].own);
        self.access(code, (slot, space), accessed, writes)
    }

    pub(crate) fn texture(
        &mut self,
        code: &Code,
        slot: u32,
        accessed: Accessed,
        (texel, writes): ([u32; 4], bool),
    ) {
        /// The largest number of texels to keep for messages. This number of texels needs one megabyte.
        const MOST: usize = 1 << 16;
        if self.texels.len() < MOST {
            self.texels.insert(accessed.word, texel);
        }
        if writes {
            self.textures[slot as usize].touched.add(accessed.index);
        }
        self.access(code, (slot, 2), accessed, writes);
    }

    #[inline]
    fn access(
        &mut self,
        code: &Code,
        (slot, space): (u32, usize),
        accessed: Accessed,
        writes: bool,
    ) -> bool {
        let Accessed { lane, site, place, index, word } = accessed;
        let plane = match place {
            Place::Byte(at) => (at & 3) as usize,
            Place::Texel(_) => 0,
        };
        let who = Who {
            invocation: self.first + self.base + lane as u32,
            epoch: self.epochs[space],
            site,
            word,
        };
        let (first, width) = (self.first, self.width);
        let shadows = if space == 2 { &mut self.textures } else { &mut self.buffers };
        let Some(cell) = shadows[slot as usize].cell(plane, index, &mut self.cells) else {
            self.unwatched += 1;
            return false;
        };
        let here = |other: Who| other.invocation >= first && other.invocation - first < width;
        let races = |other: &Who| {
            other.invocation != NONE
                && other.invocation != who.invocation
                && (!here(*other) || other.epoch == who.epoch)
        };
        let is_read_now = here(cell.reads[0]) && cell.reads[0].epoch == who.epoch;
        // If there was a write in this epoch, it would have raced with one of the two readers. So a third reader can't
        // race with a write either.
        if !writes && is_read_now && cell.clean == 2 {
            return here(cell.write);
        }
        let known = [&cell.write, &cell.other, &cell.unequal, &cell.earlier_write];
        let is_raced = known.into_iter().any(races);
        let before = if is_raced { known.map(|who| *who) } else { [NONE_YET; 4] };
        let mut read = None;
        if writes {
            read = [cell.reads[0], cell.reads[1], cell.earlier_read].into_iter().find(races);
            if cell.write.invocation != who.invocation {
                cell.other = cell.write;
            }
            if cell.write.word != word {
                cell.unequal = cell.write;
            }
            if !here(cell.write) {
                cell.earlier_write = cell.write;
            }
            cell.write = who;
            cell.clean = 0;
        } else if is_read_now {
            if cell.reads[0].invocation != who.invocation {
                cell.reads[1] = who;
                cell.clean = if is_raced { 0 } else { 2 * cell.clean };
            }
        } else {
            cell.clean = u8::from(!is_raced);
            if !here(cell.reads[0]) {
                cell.earlier_read = cell.reads[0];
            }
            cell.reads = [who, NONE_YET];
        }
        let is_written = here(cell.write);
        if is_raced || read.is_some() {
            self.raced(code, (slot, space), (who, writes), (before, read), (place, plane, index));
        }
        is_written
    }

    #[cold]
    fn raced(
        &mut self,
        code: &Code,
        (slot, space): (u32, usize),
        (who, writes): (Who, bool),
        (before, read): ([Who; 4], Option<Who>),
        (place, plane, index): (Place, usize, usize),
    ) {
        let Who { site, word, .. } = who;
        let (first, width) = (self.first, self.width);
        let here = |other: Who| other.invocation >= first && other.invocation - first < width;
        let races = |other: &&Who| {
            other.invocation != NONE
                && other.invocation != who.invocation
                && (!here(**other) || other.epoch == who.epoch)
        };
        // Two writes of the same word are weaker evidence than a read and a write, or than writes of different words.
        let differs = |other: &&Who| !writes || other.word != word;
        let racing = || before.iter().filter(races);
        let found = racing().find(differs).map(|other| (*other, true));
        let found = found.or(read.map(|other| (other, false)));
        let found = found.or_else(|| racing().next().map(|other| (*other, true)));
        let Some((other, other_writes)) = found else { return };
        let one_workgroup = here(other);
        let equal = writes && other_writes && other.word == word;
        let sites = (other.site.min(site), other.site.max(site));
        let variable = slot | u32::from(space == 2) << 31;
        let key = (variable, equal, sites, one_workgroup);
        if let Some((race, elements)) = self.races.get_mut(&key) {
            if elements.insert((plane, index)) {
                race.elements += 1;
            }
            return;
        }
        let least = (variable, equal, (0, 0), false);
        let most = (variable, equal, (u32::MAX, u32::MAX), true);
        if self.races.range(least..=most).count() >= MOST_RACES {
            return;
        }
        let (variable, binding) = match space {
            2 => {
                let slot = &code.textures[slot as usize];
                (slot.name.clone(), Some((slot.group, slot.binding)))
            }
            _ => {
                let slot = &code.buffers[slot as usize];
                let binding = match slot.binding {
                    Binding::Resource { group, binding } => Some((group, binding)),
                    Binding::Workgroup => None,
                };
                (slot.name.clone(), binding)
            }
        };
        let access = |who: Who, writes: bool| Access {
            site: code.sites[who.site as usize].clone(),
            invocation: self.invocation(who.invocation),
            writes,
            word: who.word,
            texel: self.texels.get(&who.word).filter(|_| space == 2).copied(),
        };
        let (first, second) = (access(other, other_writes), access(who, writes));
        let race = Race { variable, binding, place, first, second, one_workgroup, elements: 1 };
        self.races.insert(key, (race, HashSet::from([(plane, index)])));
    }

    pub(crate) fn end(self, code: &Code) -> Observed {
        let slots = code.buffers.iter().zip(self.buffers);
        let written = slots.filter_map(|(slot, shadow)| match slot.binding {
            Binding::Resource { group, binding } if slot.written => {
                Some(((group, binding), shadow.touched))
            }
            _ => None,
        });
        let textures = code.textures.iter().zip(self.textures).filter(|(slot, _)| slot.written);
        let textures = textures.map(|(slot, shadow)| ((slot.group, slot.binding), shadow.touched));
        let written = written.chain(textures).collect();
        let outside = self.outside.into_values();
        let outside = outside.map(|one| Outside { of: self.ran[one.number as usize], ..one });
        let outside = outside.collect();
        let mut races: Vec<Race> = self.races.into_values().map(|(race, _)| race).collect();
        races.sort_by_key(|race| {
            let place = race.second.site.span.to_range().map(|range| range.start);
            (race.writes_equally(), place, !race.one_workgroup)
        });
        Observed {
            races,
            divergences: self.divergences.into_values().collect(),
            outside,
            unwritten: self.unwritten.into_values().collect(),
            written,
            stopped: None,
            rounds: 0,
            turns: 0,
            atomics: self.atomics,
            order: Vec::new(),
            invocations: self.starts.len() * self.width as usize,
            unwatched: self.unwatched,
        }
    }
}

impl Shadow {
    /// The earlier accesses to an element. `None` if the detector already stores [`MOST_CELLS`] elements.
    fn cell(&mut self, plane: usize, index: usize, cells: &mut usize) -> Option<&mut Cell> {
        let pages = &mut self.pages[plane];
        let page = index / PAGE;
        if page >= pages.len() {
            pages.resize_with(page + 1, || None);
        }
        let page = &mut pages[page];
        if page.is_none() {
            if *cells + PAGE > MOST_CELLS {
                return None;
            }
            *cells += PAGE;
        }
        let count = if self.own { PAGE.min(self.words - index / PAGE * PAGE) } else { PAGE };
        let page = page.get_or_insert_with(|| vec![EMPTY; count].into_boxed_slice());
        Some(&mut page[index % PAGE])
    }
}
