//! What the generator refuses, it refuses by name.

#[path = "../../build/emit.rs"]
mod emit;
#[path = "../../build/layout.rs"]
mod layout;
#[path = "../../build/model.rs"]
mod model;
#[path = "../../build/names.rs"]
mod names;
#[path = "../../build/signal.rs"]
mod signal;
#[path = "../../build/tables.rs"]
mod tables;

use model::Contract;

const GOOD: &str = r#"VERSION ""

NS_ :

BS_:

BU_: Rig Ecu

BO_ 2566852736 Demo: 16 Rig
 SG_ E2eCrc : 0|16@1+ (1,0) [0|65535] "" Ecu
 SG_ E2eCounter : 16|8@1+ (1,0) [0|255] "" Ecu
 SG_ DemoPage M : 24|8@1+ (1,0) [0|1] "" Ecu
 SG_ Speed_0 m0 : 32|16@1- (0.01,0) [-327.68|327.67] "m/s" Ecu
 SG_ Speed_1 m1 : 32|16@1- (0.01,0) [-327.68|327.67] "m/s" Ecu

CM_ BO_ 2566852736 "A message.";
CM_ SG_ 2566852736 E2eCrc "CRC.";
CM_ SG_ 2566852736 E2eCounter "Counter.";
CM_ SG_ 2566852736 DemoPage "Page.";
CM_ SG_ 2566852736 Speed_0 "Speed.";
CM_ SG_ 2566852736 Speed_1 "Speed.";
BA_DEF_ BO_ "VFrameFormat" INT 0 15;
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_ BO_ "E2EDataId" INT 0 65535;
BA_DEF_ SG_ "GenSigStartValue" INT 0 65535;
BA_DEF_DEF_ "VFrameFormat" 15;
BA_DEF_DEF_ "GenMsgCycleTime" 10;
BA_DEF_DEF_ "E2EDataId" 5;
BA_DEF_DEF_ "GenSigStartValue" 0;
"#;

fn refusal(from: &str, to: &str) -> String {
    assert!(GOOD.contains(from), "{from}");
    match Contract::read(&GOOD.replace(from, to), None) {
        Ok(_) => panic!("accepted with {to}"),
        Err(refusal) => refusal,
    }
}

#[test]
fn a_good_dbc_is_understood() {
    let contract = Contract::read(GOOD, None).expect("good");
    let message = &contract.messages[0];
    let fields: Vec<_> = message.fields.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(fields, ["page", "speed_mps"]);
    let data_id = message.protection.data_id();
    assert_eq!((message.id, message.cycle_time_ms, data_id), (0x18FF_1080, 10, Some(5)));
    assert_eq!((message.signals[3].raw_min, message.signals[3].raw_max), (-32_768, 32_767));
    let code = emit::code(&contract);
    for line in ["pub speed_mps: f64,", "pub page: u8,", "pub const ID: u32 = 0x18FF1080;"] {
        assert!(code.contains(line), "{line}");
    }
}

#[test]
fn each_fault_is_refused_with_its_place() {
    for (from, to, expected) in [
        ("BU_: Rig", "BU_ Rig Rig:", "not a DBC"),
        ("BO_ 2566852736 Demo", "BO_ 256 Demo", "29-bit"),
        ("Demo: 16", "Demo: 17", "17 bytes"),
        ("\"VFrameFormat\" 15", "\"VFrameFormat\" 14", "ExtendedCAN_FD"),
        ("\"E2EDataId\" 5", "\"E2EDataId\" 0", "E2EDataId 0"),
        ("\"GenMsgCycleTime\" 10", "\"GenMsgCycleTime\" 0", "GenMsgCycleTime 0"),
        ("E2eCounter : 16|8", "E2eCounter : 17|8", "E2eCounter must be at 16|8"),
        ("DemoPage M : 24|8", "DemoPage M : 25|8", "DemoPage and Speed_0 overlap"),
        ("Speed_1 m1 : 32|16@1", "Speed_1 m1 : 32|16@0", "Speed_1: Motorola"),
        ("Speed_1 m1 : 32|16", "Speed_1 m1 : 120|16", "Speed_1: bits 120|16"),
        ("Speed_1 m1 : 32|16", "Speed_1 m1 : 48|16", "Speed_1: pages must be alike"),
        ("Speed_1 m1", "Pace_1 m1", "Pace_1"),
        ("[0|1]", "[0|2]", "2 whole pages"),
        ("(0.01,0) [-327.68|327.67]", "(0.01,0) [-328|327.67]", "Speed_0: range"),
        ("(0.01,0)", "(0,0)", "Speed_0: factor 0"),
        ("\"m/s\"", "\"furlong\"", "no suffix for unit \"furlong\""),
        ("CM_ SG_ 2566852736 DemoPage \"Page.\";", "", "DemoPage: it has no CM_"),
        ("\"GenSigStartValue\" 0;", "\"GenSigStartValue\" 7;", "start value 7 is out of range"),
    ] {
        let refusal = refusal(from, to);
        assert!(refusal.contains(expected), "{to}: {refusal}");
    }
}

#[test]
fn names_follow_the_house_style() {
    assert_eq!(names::snake_case("PositionX"), "position_x");
    assert_eq!(names::constant_case("V2vState"), "V2V_STATE");
    assert_eq!(names::variant("held previous plan").as_deref(), Some("HeldPreviousPlan"));
    assert_eq!(names::variant("3rd"), None);
    assert_eq!(names::unit_suffix("rad/s"), Some("_radps"));
}
