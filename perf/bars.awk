# A bar chart as SVG from lines "label,value": awk -v title=TEXT -v unit=TEXT -f bars.awk. The scale is logarithmic
# where values differ by more than a factor of 50.
BEGIN { FS = "," }
$2 > 0 {
    label[++count] = $1
    value[count] = $2 + 0
    if (count == 1 || value[count] > high) high = value[count]
    if (count == 1 || value[count] < low) low = value[count]
}
function clean(text) {
    gsub(/&/, "\\&amp;", text)
    gsub(/</, "\\&lt;", text)
    return text
}
function width(v) { return high > 50 * low ? 20 + 480 * log(v / low) / log(high / low) : 500 * v / high }
END {
    printf "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"960\" height=\"%d\"", 40 + 16 * count
    print " font-family=\"sans-serif\" font-size=\"11\"><rect width=\"100%\" height=\"100%\" fill=\"white\"/>"
    scale = high > 50 * low ? ", logarithmic" : ""
    printf "<text x=\"10\" y=\"20\" font-size=\"14\">%s%s</text>\n", clean(title), scale
    for (i = 1; i <= count; i++) {
        y = 30 + 16 * i
        printf "<text x=\"330\" y=\"%d\" text-anchor=\"end\">%s</text>", y, clean(label[i])
        printf "<rect x=\"340\" y=\"%d\" width=\"%.1f\" height=\"12\" fill=\"#4878a8\"/>", y - 10, width(value[i])
        printf "<text x=\"%.1f\" y=\"%d\">%.3g %s</text>\n", 346 + width(value[i]), y, value[i], unit
    }
    print "</svg>"
}
