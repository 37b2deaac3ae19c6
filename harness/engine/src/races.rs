//! Finds races: two invocations access one element, at least one of them writes, and nothing orders the accesses.
//!
//! WGSL orders few accesses (15.4 *Memory model*, 17.11 *Synchronization built-in functions*). A barrier orders the
//! invocations of its workgroup, for the address spaces that its name says. Nothing orders two workgroups of a
//! dispatch. Atomic accesses don't race with each other, and WGSL has no other way to access an atomic.
//!
//! The machine runs invocations in lockstep, so a race doesn't show in the results. Instead each element remembers
//! accesses that a later one could race with:
//!
//! - the last write, and the last write by another invocation. If the current epoch has a write by an invocation other
//!   than the current one, it is one of these two;
//! - the last write by an earlier workgroup;
//! - the last write of another word, which tells equal writes from unequal ones;
//! - two reads of different invocations since the last barrier, and one by an earlier workgroup.

use std::collections::{BTreeMap, HashMap, HashSet};

use naga::Barrier;

use crate::code::{Binding, Code, Site};
use crate::dispatch::Turn;
use crate::explore::{Access as Touch, Word};
use crate::refusal::Stop;

/// The bytes, or texels, whose elements are allocated together. Most of a large buffer may never be accessed.
const PAGE: usize = 1024;

/// The most elements that a dispatch remembers, at 116 bytes each: 116 MiB. Accesses of further elements are only
/// counted.
const MOST_CELLS: usize = 1 << 20;
const _: () = assert!(size_of::<Cell>() == 116);

/// The most races to keep for a variable, each with another pair of lines; equal writes and other races count apart. A
/// loop over a buffer may have a race for each element, all with the same lines.
const MOST_RACES: usize = 64;

/// No invocation.
const NONE: u32 = u32::MAX;

/// The place of an element, a scalar, in its variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The offset in bytes in its variable.
    Byte(u32),
    /// The texel.
    Texel([u32; 3]),
}

/// An access of an element.
#[derive(Clone, Debug)]
pub struct Access {
    /// The place of the access in the source.
    pub site: Site,
    /// The number of the invocation in the dispatch: workgroup after workgroup, and within one by
    /// `local_invocation_index`.
    pub invocation: usize,
    /// `true` for a write.
    pub writes: bool,
    /// The word that it writes or reads.
    pub word: u32,
    /// For a texel, its channels, if they were kept.
    pub texel: Option<[u32; 4]>,
}

/// Two accesses of an element that nothing orders.
#[derive(Clone, Debug)]
pub struct Race {
    /// The name of the variable in the module.
    pub variable: String,
    /// The group and binding of the variable; `None` for workgroup memory.
    pub binding: Option<(u32, u32)>,
    /// The element.
    pub place: Place,
    /// The access that came first in the machine's order.
    pub first: Access,
    /// The other one.
    pub second: Access,
    /// `true` if their invocations are in one workgroup, so that a barrier could order them.
    pub one_workgroup: bool,
    /// The number of elements with a race between these two accesses, this one included.
    pub elements: u64,
}

impl Race {
    /// Returns `true` if both write, and write the same.
    #[must_use]
    pub fn writes_equally(&self) -> bool {
        self.first.writes && self.second.writes && self.first.word == self.second.word
    }
}

/// A barrier that not all invocations of a workgroup reached together, or such an operation of a subgroup.
#[derive(Clone, Debug)]
pub struct Divergence {
    /// The barrier.
    pub site: Site,
    /// An invocation that reached it.
    pub reached: usize,
    /// The first invocation that didn't.
    pub missing: usize,
    /// The number of invocations that didn't.
    pub count: usize,
    /// `true` for a subgroup operation.
    pub subgroup: bool,
    /// The condition or the jump at which that invocation went another way; `None` if it never reached a part of the
    /// code that leads to the barrier.
    pub parted: Option<Site>,
}

/// Reads of an element that nothing has written: of workgroup memory, which WGSL initializes to zero, or of a blank
/// buffer.
#[derive(Clone, Debug)]
pub struct Unwritten {
    /// The first of these reads.
    pub access: Access,
    /// The name of the variable in the module.
    pub variable: String,
    /// `true` for workgroup memory.
    pub own: bool,
    /// The offset in bytes of the first such element in its variable.
    pub byte: u32,
    /// The number of reads of such elements by the same line.
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
    /// A subgroup without such an invocation, or in which it isn't active.
    Subgroup,
    /// None: the index is inside the array, but only because a sum or a product has wrapped around.
    Wrapped,
}

/// Indices of an operation that are outside their array.
#[derive(Clone, Debug)]
pub struct Outside {
    /// The operation.
    pub site: Site,
    /// The first invocation with such an index.
    pub invocation: usize,
    /// The number of such indices.
    pub count: u64,
    /// `true` for a write or an atomic.
    pub writes: bool,
    /// The kind of object that it is outside of.
    pub bounds: Bounds,
    /// The buffer, workgroup variable or texture with the array; `None` for a variable of the invocation.
    pub variable: Option<String>,
    /// `true` for an array inside another array or a structure.
    pub nested: bool,
    /// The index in that invocation, and the number of elements, if the array is in a buffer. For an index that wraps:
    /// its value without wrapping, and its value.
    pub index: Option<(i64, u64)>,
    /// The number of times that the operation ran.
    pub of: u64,
    /// The number that [`Options::outside_at`](crate::Options::outside_at) takes for the operation.
    pub number: u32,
}

/// An index of an operation that is outside its array.
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
    /// Races, the first of each pair of lines. Races of reads or unequal writes come before equal writes.
    pub races: Vec<Race>,
    /// Barriers that not all invocations reached, each once.
    pub divergences: Vec<Divergence>,
    /// Operations with indices outside their arrays or textures, each once.
    pub outside: Vec<Outside>,
    /// Reads of unwritten workgroup memory and blank buffers, one for each line.
    pub unwritten: Vec<Unwritten>,
    /// The words, or texels, that the program wrote in each storage buffer or storage texture that it may write, by
    /// group and binding.
    pub written: BTreeMap<(u32, u32), Touched>,
    /// The reason why the dispatch ended early.
    pub stopped: Option<Stop>,
    /// The number of invocations that ran.
    pub invocations: usize,
    /// The rounds of all loops in all invocations.
    pub rounds: u64,
    /// The turns of all invocations.
    pub turns: u64,
    /// Its atomics.
    pub atomics: Atomics,
    /// The order of the atomics, if it was requested.
    pub order: Vec<Turn>,
    /// The number of accesses of elements that aren't remembered.
    pub unwatched: u64,
}

/// The atomics of a dispatch, as needed to estimate the number of their orders.
#[derive(Clone, Debug, Default)]
pub struct Atomics {
    /// The number of atomics of each invocation.
    pub of_invocation: Vec<u32>,
    /// For each word, the kinds of its atomics as bits, and their number by invocation.
    words: HashMap<Word, (u32, BTreeMap<usize, u32>)>,
    count: usize,
}

impl Atomics {
    /// The most atomics whose orders are counted. More than this have too many orders to try.
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

    /// The binary logarithm of an upper bound of the number of orders, equivalent ones counted once. Treats words as
    /// independent of each other.
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

/// An access that an element remembers: its invocation, the number of barriers of the element's address space that its
/// workgroup had passed, its site, and the word.
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
    /// The last write by another invocation than the one of `write`.
    other: Who,
    /// The last write of another word than the one of `write`.
    unequal: Who,
    /// The last write by a workgroup before the one of `write`.
    earlier_write: Who,
    /// Two invocations that read it since the last barrier.
    reads: [Who; 2],
    /// A read by an earlier workgroup.
    earlier_read: Who,
    /// The number of `reads` since the last write that raced with no write.
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

/// A set of elements of a variable, by offset in bytes; for a texture, by number of the texel, row after row.
#[derive(Clone, Debug, Default)]
pub struct Touched(Vec<u64>);

impl Touched {
    /// Returns `true` if the set has the element at this offset, or the texel with this number.
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

/// The elements of a variable.
#[derive(Debug, Default)]
struct Shadow {
    /// `true` if some instruction writes it.
    written: bool,
    /// `true` for a variable in workgroup memory.
    own: bool,
    /// `true` for a buffer with unknown contents until it is written.
    blank: bool,
    /// The words of a variable in workgroup memory, which each workgroup begins anew.
    words: usize,
    /// Elements by the byte of a word at which they begin: 16-bit floats also begin at the third byte, booleans at
    /// each.
    pages: [Vec<Option<Box<[Cell]>>>; 4],
    /// The written elements: in workgroup memory those of this workgroup; in blank buffers those of earlier passes,
    /// too.
    touched: Touched,
}

/// The state of a detector for one workgroup.
#[derive(Debug, Default)]
pub(crate) struct OfGroup {
    first: u32,
    epochs: [u32; 3],
    waiting: [bool; 3],
    /// Variables in workgroup memory.
    own: Vec<Shadow>,
}

/// A variable, `true` for a race of equal writes, both sites, and `true` if both are in one workgroup.
type Key = (u32, bool, (u32, u32), bool);

/// Finds races while a dispatch runs.
#[derive(Debug)]
pub(crate) struct Detector {
    /// The number of invocations of a workgroup.
    width: u32,
    /// The first invocation of each workgroup that has run; others may have been left out.
    starts: Vec<usize>,
    /// The number of the current workgroup's first invocation, among those that run.
    first: u32,
    /// The barriers that the workgroup has passed, for workgroup memory, storage and textures.
    epochs: [u32; 3],
    /// The first current lane, and the address spaces of the barriers at which the others wait.
    base: u32,
    waiting: [bool; 3],
    buffers: Vec<Shadow>,
    textures: Vec<Shadow>,
    cells: usize,
    unwatched: u64,
    races: BTreeMap<Key, (Race, HashSet<(usize, usize)>)>,
    divergences: BTreeMap<u32, Divergence>,
    outside: BTreeMap<u32, Outside>,
    unwritten: BTreeMap<u32, Unwritten>,
    /// The channels of texels, by their hashes.
    texels: HashMap<u32, [u32; 4]>,
    /// The number of times that the operations with an index ran, by site.
    ran: Vec<u64>,
    atomics: Atomics,
}

/// An access that the machine makes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Accessed {
    pub(crate) lane: usize,
    pub(crate) site: u32,
    pub(crate) place: Place,
    /// The number of the element among those that begin at the same byte of a word.
    pub(crate) index: usize,
    pub(crate) word: u32,
}

impl Detector {
    /// A detector for workgroups of so many invocations, with the written elements of blank buffers.
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

    /// Counts the lanes that run an operation with an index.
    pub(crate) fn run(&mut self, site: u32, lanes: usize) {
        self.ran[site as usize] += lanes as u64;
    }

    /// Begins the workgroup with this first invocation.
    pub(crate) fn begin(&mut self, first: usize) {
        self.first = self.starts.len() as u32 * self.width;
        self.starts.push(first);
        (self.epochs, self.waiting) = ([0; 3], [false; 3]);
        for shadow in self.buffers.iter_mut().filter(|shadow| shadow.own) {
            shadow.touched.0.fill(0);
            shadow.pages.iter_mut().flatten().flatten().for_each(|page| page.fill(EMPTY));
        }
    }

    /// Continues another workgroup: exchanges the state of the two.
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

    /// The number of an invocation in the whole dispatch.
    fn invocation(&self, number: u32) -> usize {
        let (group, lane) = (number / self.width, number % self.width);
        self.starts[group as usize] + lane as usize
    }

    /// The number of a current lane in the whole dispatch.
    fn of_lane(&self, lane: usize) -> usize {
        self.invocation(self.first + self.base + lane as u32)
    }

    /// Continues lanes of the workgroup, beginning with this one.
    pub(crate) fn goes_on(&mut self, base: usize) {
        self.base = base as u32;
    }

    /// Releases all invocations of the workgroup that haven't ended from a barrier. `held` has the first invocation of
    /// each machine with the site of its barrier; `lanes` invocations share a machine.
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

    /// Returns `true` if accesses of a buffer can race, or can read unwritten elements.
    pub(crate) fn watches_buffer(&self, slot: u32) -> bool {
        let Shadow { written, own, blank, .. } = self.buffers[slot as usize];
        written || own || blank
    }

    /// Returns `true` if accesses of a texture can race.
    pub(crate) fn watches_texture(&self, slot: u32) -> bool {
        self.textures[slot as usize].written
    }

    /// Notes a barrier that the invocations of `active` reach. `parted` says where the others went another way.
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

    /// Notes an operation that all invocations should reach together: the first of these lanes, whether they are a
    /// subgroup, where other lanes went another way, and the lanes that reach it.
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

    /// Notes an access of an element of a buffer: a read, a write or both, atomic or not.
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

    /// Notes an atomic of a lane at an offset of a buffer.
    pub(crate) fn atomic(&mut self, lane: usize, (slot, at): (u32, usize), kind: Touch) {
        let group = if self.buffers[slot as usize].own { self.first + 1 } else { 0 };
        self.atomics.add(self.of_lane(lane), (slot, group, at as u32), kind);
    }

    /// Notes an index of a lane that is outside its array.
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

    /// Notes a read or a write of an element. Returns `true` if its workgroup has written it.
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

    /// Notes a read or a write of a texel with these channels.
    pub(crate) fn texture(
        &mut self,
        code: &Code,
        slot: u32,
        accessed: Accessed,
        (texel, writes): ([u32; 4], bool),
    ) {
        /// The most texels to keep for messages: a megabyte of them.
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
        // A write in this epoch would have raced with one of the two readers, so a third reader can't race with it
        // either.
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

    /// Notes a race between an access and an earlier one.
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
        // Two writes of one word are weaker evidence than a read beside a write, or writes of different words.
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

    /// Ends the run and returns the findings.
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
    /// The state of an element; `None` if there are too many.
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
