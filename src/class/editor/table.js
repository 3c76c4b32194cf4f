// The blocks: a row each, with its text in English, German and Italian, and the Luau that it makes. In both, `%1` and
// `{0}` are the first argument. The blocks' names are stored in files: they stay as they are.

export const LANGUAGES = ["en", "de", "it"];

const number = (usual, low, high) => ({ type: "input_value", check: "Number", usual: { type: "easy_number", fields: { A0: usual } }, low, high, empty: "0" });
const words = (usual) => ({ type: "input_value", usual: { type: "easy_text", fields: { A0: usual } }, empty: "\"\"" });
const condition = { type: "input_value", check: "Boolean", empty: "false" };
const body = { type: "input_statement" };
const variable = { type: "field_variable", variable: "n" };
const choice = (...names) => ({ type: "field_dropdown", names });
const literal = (type, usual) => ({ type, ...usual });

/** A block at the top of a stack. */
const HAT = { hat: true };
/** A block after which other scripts had time to run. */
const WAITS = { waits: true };
/** A loop that needs a pause. */
const LOOP = { pauses: true };
const value = (output, order) => ({ output, order });
const COLOURS = choice("red", "orange", "yellow", "green", "cyan", "blue", "magenta");

const ROWS = [
  ["start", "events", HAT, ["when the program starts", "wenn das Programm beginnt", "quando il programma parte"], "{next}"],
  ["event", "events", HAT, ["whenever %1", "jedes Mal, wenn %1", "ogni volta che %1"], "robot.on(\"{0}\", function()\n{next}\nend)",
    choice("noise", "battery_low", "charging", "charged", "docked", "undocked", "sound_finished")],

  ["drive", "moving", WAITS, ["drive %1 centimetres", "fahre %1 Zentimeter", "avanza di %1 centimetri"], "easy.drive({0})", number(40, -1000, 1000)],
  ["forward", "moving", WAITS, ["forwards %1 seconds, speed %2 %%", "vorwärts %1 Sekunden, Tempo %2 %%", "avanti %1 secondi, velocità %2 %%"],
    "easy.forward({0}, {1})", number(2, 0, 60), number(50, 1, 100)],
  ["back", "moving", WAITS, ["backwards %1 seconds, speed %2 %%", "rückwärts %1 Sekunden, Tempo %2 %%", "indietro %1 secondi, velocità %2 %%"],
    "easy.back({0}, {1})", number(2, 0, 60), number(50, 1, 100)],
  ["turn", "moving", WAITS, ["turn %1 by %2 degrees", "drehe nach %1 um %2 Grad", "gira a %1 di %2 gradi"], "easy.{0}({1})", choice("left", "right"), number(90, -3600, 3600)],
  ["stop", "moving", {}, ["stop", "halte an", "fermati"], "easy.stop()"],
  ["go_home", "moving", WAITS, ["drive to the charging station", "fahre zur Ladestation", "vai alla base di ricarica"], "easy.go_home()"],
  ["leave_home", "moving", WAITS, ["leave the charging station", "verlasse die Ladestation", "lascia la base di ricarica"], "easy.leave_home()"],

  ["light", "lights", {}, ["switch light %1 %2", "schalte Licht %1 %2", "luce %1 %2"], "easy.light(\"{0}\", \"{1}\")", choice("left", "right", "flash", "all"), choice("on", "off")],
  ["sound", "lights", {}, ["play the sound %1", "spiele den Ton %1", "suona %1"], "easy.sound(\"{0}\")",
    choice("bip_2", "bip_3", "bip_4", "laugh", "laser", "alarm", "bomb", "engine", "robot", "snapshot", "music")],
  ["print", "lights", {}, ["print %1", "schreibe %1", "scrivi %1"], "print({0})", words("hello")],
  ["print2", "lights", {}, ["print %1 and %2", "schreibe %1 und %2", "scrivi %1 e %2"], "print({0}, {1})", words("battery:"), number(0)],

  ["look", "seeing", WAITS, ["look for something %1", "suche etwas in %1", "cerca qualcosa di %1"], "thing = easy.see(\"{0}\")", COLOURS],
  ["found", "seeing", value("Boolean", 3), ["it found something", "es hat etwas gefunden", "ha trovato qualcosa"], "thing ~= nil"],
  ["where", "seeing", value("Boolean", 2), ["it is %1", "es ist %1", "è %1"], "thing and thing.where == \"{0}\"", choice("left", "middle", "right")],
  ["size", "seeing", value("Number"), ["its size in %% of the picture", "seine Größe in %% des Bildes", "la sua grandezza in %% dell'immagine"], "(if thing then thing.size else 0)"],
  ["battery", "seeing", value("Number"), ["battery in %%", "Akku in %%", "batteria in %%"], "easy.battery()"],

  ["wait", "loops", WAITS, ["wait for %1 seconds", "warte %1 Sekunden", "aspetta %1 secondi"], "easy.wait({0})", number(1, 0, 3600)],
  ["wait_until", "loops", { order: 7 }, ["wait until %1", "warte, bis %1", "aspetta finché %1"], "while not {0} do\n\teasy.wait(0.1)\nend", condition],
  ["repeat", "loops", {}, ["repeat %1 times %2", "wiederhole %1 Mal %2", "ripeti %1 volte %2"], "for {count} = 1, {0} do\n{1}\nend", number(4, 0, 1000), body],
  ["forever", "loops", LOOP, ["forever %1", "für immer %1", "per sempre %1"], "while true do\n{0}\nend", body],
  ["while", "loops", LOOP, ["as long as %1 %2", "solange %1 %2", "finché è vero %1 %2"], "while {0} do\n{1}\nend", condition, body],
  ["until", "loops", { ...LOOP, order: 7 }, ["until %1 %2", "bis %1 %2", "fino a quando %1 %2"], "while not {0} do\n{1}\nend", condition, body],

  ["if", "logic", {}, ["if %1 %2", "falls %1 %2", "se %1 %2"], "if {0} then\n{1}\nend", condition, body],
  ["if_else", "logic", {}, ["if %1 %2 else %3", "falls %1 %2 sonst %3", "se %1 %2 altrimenti %3"], "if {0} then\n{1}\nelse\n{2}\nend", condition, body, body],
  ["compare", "logic", value("Boolean", "A1"), ["%1 %2 %3", "%1 %2 %3", "%1 %2 %3"], "{0} {1} {2}", number(1), choice("<", ">", "==", "~=", "<=", ">="), number(10)],
  ["both", "logic", value("Boolean", "A1"), ["%1 %2 %3", "%1 %2 %3", "%1 %2 %3"], "{0} {1} {2}", condition, choice("and", "or"), condition],
  ["not", "logic", value("Boolean", 7), ["not %1", "nicht %1", "non %1"], "not {0}", condition],

  ["number", "numbers", value("Number"), ["%1", "%1", "%1"], "{0}", literal("field_number", { value: 0 })],
  ["calculate", "numbers", value("Number", "A1"), ["%1 %2 %3", "%1 %2 %3", "%1 %2 %3"], "{0} {1} {2}", number(1), choice("+", "-", "*", "/"), number(1)],
  ["random", "numbers", value("Number"), ["random number from %1 to %2", "Zufallszahl von %1 bis %2", "numero a caso da %1 a %2"], "math.random({0}, {1})", number(1), number(6)],
  ["text", "numbers", value("String"), ["“ %1 ”", "„ %1 “", "« %1 »"], "{0}", literal("field_input", { text: "" })],

  ["set", "variables", {}, ["set %1 to %2", "setze %1 auf %2", "imposta %1 a %2"], "{0} = {1}", variable, number(0)],
  ["change", "variables", {}, ["change %1 by %2", "ändere %1 um %2", "cambia %1 di %2"], "{0} += {1}", variable, number(1)],
  ["get", "variables", value("Number"), ["%1", "%1", "%1"], "{0}", variable],
];

export const BLOCKS = new Map(ROWS.map(([key, group, traits, texts, code, ...args]) => {
  // Blockly makes classes of names and groups: the prefix keeps them apart from those of the page.
  const name = `easy_${key}`;
  return [name, { name, group, texts, code, args, ...traits }];
}));

/** Groups with their name and colour, on which white text is readable. */
export const GROUPS = {
  events: { texts: ["Beginnings", "Anfänge", "Inizi"], colour: "#8a5a00" },
  moving: { texts: ["Moving", "Fahren", "Movimento"], colour: "#0d6e9c" },
  lights: { texts: ["Lights, sounds, texts", "Licht, Ton, Text", "Luci, suoni, testi"], colour: "#9b3d8f" },
  seeing: { texts: ["Seeing", "Sehen", "Vedere"], colour: "#b3402b" },
  loops: { texts: ["Waiting, repeating", "Warten, Wiederholen", "Aspettare, ripetere"], colour: "#28763c" },
  logic: { texts: ["Conditions", "Bedingungen", "Condizioni"], colour: "#5b4fc4" },
  numbers: { texts: ["Numbers, texts", "Zahlen, Texte", "Numeri, testi"], colour: "#54656f" },
  variables: { texts: ["Variables", "Variablen", "Variabili"], colour: "#a3431c" },
};

/** Words of choices; others are the same in every language. */
export const WORDS = {
  left: ["left", "links", "sinistra"], right: ["right", "rechts", "destra"], middle: ["in the middle", "in der Mitte", "al centro"],
  flash: ["flash", "Blitz", "flash"], all: ["all", "alle", "tutte"], on: ["on", "an", "accesa"], off: ["off", "aus", "spenta"],
  and: ["and", "und", "e"], or: ["or", "oder", "o"], "==": ["="], "~=": ["≠"], "<=": ["≤"], ">=": ["≥"], "*": ["×"], "/": ["÷"], "-": ["−"],
  red: ["red", "Rot", "rosso"], orange: ["orange", "Orange", "arancione"], yellow: ["yellow", "Gelb", "giallo"], green: ["green", "Grün", "verde"],
  cyan: ["cyan", "Türkis", "ciano"], blue: ["blue", "Blau", "blu"], magenta: ["magenta", "Magenta", "magenta"],
  noise: ["it hears a noise", "er ein Geräusch hört", "sente un rumore"], battery_low: ["its battery is low", "sein Akku schwach ist", "la batteria è scarica"],
  charging: ["charging begins or ends", "das Laden beginnt oder endet", "la ricarica inizia o finisce"], charged: ["its battery is full", "sein Akku voll ist", "la batteria è carica"],
  docked: ["it comes to its station", "er auf seine Station kommt", "arriva alla base"], undocked: ["it leaves its station", "er seine Station verlässt", "lascia la base"],
  sound_finished: ["the music is over", "die Musik zu Ende ist", "la musica è finita"],
  bip_2: ["beep", "Piep", "bip"], bip_3: ["beep 3"], bip_4: ["beep 4"], laugh: ["laugh", "Lachen", "risata"], laser: ["laser", "Laser", "laser"],
  alarm: ["alarm", "Alarm", "allarme"], bomb: ["bomb", "Bombe", "bomba"], engine: ["engine", "Motor", "motore"], robot: ["robot", "Roboter", "robot"],
  snapshot: ["camera", "Kamera", "fotocamera"], music: ["music", "Musik", "musica"],
};
