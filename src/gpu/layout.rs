//! For tests: what a compiled shader says of its structs, to be compared with the Rust side, and what it does with
//! addresses.

use rspirv::binary::{Consumer, ParseAction, parse_words};
use rspirv::dr::{Instruction, ModuleHeader, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass};
use std::collections::{HashMap, HashSet};

/// Offset and type of every member, in order.
pub type Members = Vec<(u32, String)>;

/// The type's name as both sides are written here: `u32`, `f32x3`, `[u32x2; 9]`.
pub trait Name {
    fn name() -> String;
}

macro_rules! names {
    ($($scalar:ty),*) => {$(
        impl Name for $scalar {
            fn name() -> String {
                stringify!($scalar).to_owned()
            }
        }
    )*};
}
names!(u32, i32, f32);

impl<T: Name, const N: usize> Name for [T; N] {
    fn name() -> String {
        of_array(&T::name(), N as u32)
    }
}

/// Up to four scalars are a vector.
fn of_array(element: &str, n: u32) -> String {
    let scalar = ["u32", "i32", "f32"].contains(&element);
    if scalar && n <= 4 { format!("{element}x{n}") } else { format!("[{element}; {n}]") }
}

pub fn name_of<S, F: Name>(_: fn(&S) -> &F) -> String {
    F::name()
}

/// The members of a Rust struct, all of which must be listed.
macro_rules! members {
    ($of:ident { $($field:ident),* $(,)? }) => {{
        // Fails to compile when one is missing.
        let _ = |whole: $of| { let $of { $($field: _),* } = whole; };
        vec![$((
            std::mem::offset_of!($of, $field) as u32,
            $crate::gpu::layout::name_of(|s: &$of| &s.$field),
        )),*]
    }};
}
pub(crate) use members;

/// Asserts that each shader (name, words) has a struct with these very members.
pub fn assert_in(shaders: &[(&str, &[u32])], members: &Members) {
    for (name, words) in shaders {
        let mut structs = Structs::default();
        instructions(words).iter().for_each(|instruction| structs.take(instruction));
        let found = structs.all();
        assert!(found.contains(members), "{name} has no struct {members:?} among {found:?}");
    }
}

#[derive(Default)]
struct Structs {
    names: HashMap<u32, String>,
    constants: HashMap<u32, u32>,
    members: Vec<(u32, Vec<u32>)>,
    offsets: HashMap<(u32, u32), u32>,
}

fn id(operand: &Operand) -> u32 {
    operand.id_ref_any().expect("an id")
}

fn number(operand: &Operand) -> u32 {
    match operand {
        Operand::LiteralBit32(value) => *value,
        other => panic!("{other:?} is not a number"),
    }
}

impl Structs {
    fn all(&self) -> Vec<Members> {
        let member = |of: u32, (k, kind): (usize, &u32)| {
            Some((*self.offsets.get(&(of, k as u32))?, self.names.get(kind).cloned().unwrap_or_default()))
        };
        self.members
            .iter()
            .map(|(of, kinds)| kinds.iter().enumerate().filter_map(|m| member(*of, m)).collect())
            .collect()
    }

    fn take(&mut self, instruction: &Instruction) {
        let operands = &instruction.operands;
        let of = |k: usize, names: &HashMap<u32, String>| {
            names.get(&id(&operands[k])).cloned().unwrap_or_default()
        };
        let name = match instruction.class.opcode {
            Op::TypeInt => if number(&operands[1]) == 0 { "u32" } else { "i32" }.to_owned(),
            Op::TypeFloat => "f32".to_owned(),
            Op::TypeVector => of_array(&of(0, &self.names), number(&operands[1])),
            Op::TypeArray => of_array(&of(0, &self.names), self.constants[&id(&operands[1])]),
            Op::Constant => {
                if let (Some(result), Operand::LiteralBit32(value)) = (instruction.result_id, &operands[0]) {
                    self.constants.insert(result, *value);
                }
                return;
            }
            Op::TypeStruct => {
                let result = instruction.result_id.expect("a type has an id");
                self.members.push((result, operands.iter().map(id).collect()));
                "struct".to_owned()
            }
            Op::MemberDecorate => {
                if let Operand::Decoration(Decoration::Offset) = operands[2] {
                    self.offsets.insert((id(&operands[0]), number(&operands[1])), number(&operands[3]));
                }
                return;
            }
            _ => return,
        };
        if let Some(result) = instruction.result_id {
            self.names.insert(result, name);
        }
    }
}

/// How often a shader follows an address, or what it does to the bits of one before.
pub fn addresses(words: &[u32]) -> Result<usize, Op> {
    let all = instructions(words);
    let places: HashSet<u32> = all
        .iter()
        .filter(|i| i.class.opcode == Op::TypePointer)
        .filter(|i| i.operands[0] == Operand::StorageClass(StorageClass::PhysicalStorageBuffer))
        .filter_map(|i| i.result_id)
        .collect();
    let made: HashMap<u32, &Instruction> = all.iter().filter_map(|i| Some((i.result_id?, i))).collect();
    let followed = all.iter().filter(|i| {
        i.class.opcode == Op::Bitcast && i.result_type.is_some_and(|kind| places.contains(&kind))
    });
    let (mut seen, mut count) = (HashSet::new(), 0);
    let mut open: Vec<u32> = followed.inspect(|_| count += 1).map(|i| id(&i.operands[0])).collect();
    while let Some(value) = open.pop() {
        let Some(by) = made.get(&value).filter(|_| seen.insert(value)) else { continue };
        match by.class.opcode {
            // Taken apart, put together, chosen.
            Op::CompositeExtract
            | Op::CompositeConstruct
            | Op::CompositeInsert
            | Op::VectorShuffle
            | Op::CopyObject
            | Op::CopyLogical
            | Op::Phi
            | Op::Select => open.extend(by.operands.iter().filter_map(Operand::id_ref_any)),
            // As it was stored.
            Op::Load | Op::ImageRead | Op::FunctionParameter | Op::Undef => {}
            // "No section".
            Op::ConstantNull | Op::ConstantComposite | Op::Constant => {}
            // The condition of a choice, and the labels of its ways.
            Op::Label => {}
            opcode if is_condition(opcode) => {}
            opcode => return Err(opcode),
        }
    }
    Ok(count)
}

/// Whether the result is true or false.
fn is_condition(opcode: Op) -> bool {
    use Op::*;
    let compares = [IEqual, INotEqual, UGreaterThan, SGreaterThan, ULessThan, SLessThan, UGreaterThanEqual];
    let more =
        [SGreaterThanEqual, ULessThanEqual, SLessThanEqual, LogicalAnd, LogicalOr, LogicalNot, Any, All];
    let constants = [ConstantTrue, ConstantFalse, SpecConstantTrue, SpecConstantFalse, SpecConstantOp];
    compares.contains(&opcode) || more.contains(&opcode) || constants.contains(&opcode)
}

/// All instructions of a module, in order. The full loader of rspirv refuses `LocalSizeId`.
fn instructions(words: &[u32]) -> Vec<Instruction> {
    let mut all = Instructions::default();
    parse_words(words, &mut all).unwrap();
    all.0
}

#[derive(Default)]
struct Instructions(Vec<Instruction>);

impl Consumer for Instructions {
    fn initialize(&mut self) -> ParseAction {
        ParseAction::Continue
    }

    fn finalize(&mut self) -> ParseAction {
        ParseAction::Continue
    }

    fn consume_header(&mut self, _: ModuleHeader) -> ParseAction {
        ParseAction::Continue
    }

    fn consume_instruction(&mut self, instruction: Instruction) -> ParseAction {
        self.0.push(instruction);
        ParseAction::Continue
    }
}

#[test]
fn a_wrong_layout_is_found() {
    let shader = [("overlay.vert", super::shaders::OVERLAY_VERT)];
    // A corner of a triangle, and what it is not.
    let right: Members = [(0, "f32x2"), (8, "f32x2"), (16, "u32")].map(|(o, n)| (o, n.to_owned())).into();
    let mut wrong = right.clone();
    wrong[2].0 = 20;
    assert_in(&shader, &right);
    assert!(std::panic::catch_unwind(|| assert_in(&shader, &wrong)).is_err());
}
