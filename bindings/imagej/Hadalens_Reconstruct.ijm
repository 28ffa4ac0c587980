// Hadalens for ImageJ and Fiji: reconstructs a raw frame with the program `hadalens`, and opens what comes of it.
// Install with Plugins > Macros > Install..., or put it into Fiji's folder plugins/. It asks for files; a script hands
// them over instead:
//   imagej -batch Hadalens_Reconstruct.ijm "raw=frame.tif model=camera.model output=folder program=hadalens"
// (one word each; or one a line, then with spaces inside). In batch mode it prints what it opened.
// The stack and the distance map are opened; the all-in-focus image lies beside them, as float RGB, which ImageJ itself
// does not read.

given = getArgument();
if (given == "") {
    Dialog.create("Hadalens: reconstruct");
    Dialog.addFile("Raw frame (TIFF)", "");
    Dialog.addFile("Camera (model)", call("ij.Prefs.get", "hadalens.model", ""));
    Dialog.addDirectory("Results", call("ij.Prefs.get", "hadalens.output", ""));
    Dialog.addString("Program", call("ij.Prefs.get", "hadalens.program", "hadalens"), 40);
    Dialog.show();
    raw = Dialog.getString();
    model = Dialog.getString();
    output = Dialog.getString();
    program = Dialog.getString();
    call("ij.Prefs.set", "hadalens.model", model);
    call("ij.Prefs.set", "hadalens.output", output);
    call("ij.Prefs.set", "hadalens.program", program);
} else {
    raw = word(given, "raw", "");
    model = word(given, "model", "");
    output = word(given, "output", "");
    program = word(given, "program", "hadalens");
}
if (raw == "" || model == "" || output == "")
    stop("a raw frame, a model and a folder for the results are needed");
if (!File.exists(raw))
    stop("there is no file " + raw);

results = output + File.separator + File.getNameWithoutExtension(raw);
old = written(results + "_stack.tif");
showStatus("Hadalens: reconstructing " + File.getName(raw));
said = exec(program, "reconstruct", raw, "-m", model, "-o", output, "--no-preview", "--json");
if (written(results + "_stack.tif") == old)
    stop("it was not done: " + reason(said));

if (File.exists(results + "_depth.tif")) // not of a single depth
    show(results + "_depth.tif");
show(results + "_stack.tif");

// Why, of what the program says.
function reason(json) {
    from = indexOf(json, "\"message\": \"");
    if (from < 0)
        return "does the program '" + program + "' start in a terminal?";
    from = from + 12;
    return substring(json, from, indexOf(json, "\"\n", from));
}

// When a file was written; -1 where there is none.
function written(path) {
    if (File.exists(path))
        return parseInt(File.lastModified(path));
    return -1;
}

// Without anybody who could close a window, the message is printed.
function stop(message) {
    if (getArgument() == "")
        exit("Hadalens: " + message);
    print("Hadalens: " + message);
    exit();
}

function show(path) {
    open(path);
    getDimensions(width, height, channels, slices, frames);
    if (getArgument() != "")
        print(getTitle() + ": " + width + "x" + height + "x" + channels + "x" + slices + " " + getInfo("slice.label"));
}

// The value of `key` in "key=value" words or lines.
function word(text, key, otherwise) {
    separator = " ";
    if (indexOf(text, "\n") >= 0)
        separator = "\n";
    parts = split(text, separator);
    for (i = 0; i < parts.length; i++)
        if (startsWith(parts[i], key + "="))
            return substring(parts[i], lengthOf(key) + 1);
    return otherwise;
}
