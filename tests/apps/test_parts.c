/* The parts of the programs that need no program to be tested. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "compare.h"
#include "half.h"
#include "imageio.h"
#include "json.h"
#include "layers.h"
#include "options.h"
#include "pattern.h"
#include "platform.h"
#include "sequence.h"

/* ---- Half precision -------------------------------------------------------------------------- */

static void half_to_float_and_back_is_exact(void)
{
    for (unsigned h = 0; h < 0x10000; h++) {
        float f = half_to_float((uint16_t)h);
        if ((h & 0x7fff) > 0x7c00)
            CHECK(isnan(f) && (half_from_float(f) & 0x7fff) > 0x7c00);
        else
            CHECK_EQ(half_from_float(f), h);
    }
}

static void half_has_the_value_of_its_bits(void)
{
    for (unsigned h = 0; h < 0x7c00; h++) {
        int exponent = (int)(h >> 10);
        double mantissa = (h & 0x3ff) / 1024.0;
        double value = exponent ? ldexp(1 + mantissa, exponent - 15) : ldexp(mantissa, -14);
        CHECK(half_to_float((uint16_t)h) == value);
        CHECK(half_to_float((uint16_t)(h | 0x8000)) == -value);
    }
    CHECK(isinf(half_to_float(0x7c00)) && half_to_float(0xfc00) < 0);
}

/* Between two neighbours: below the middle the lower, above it the upper, at it the even one. */
static void half_rounds_to_nearest_even(void)
{
    for (unsigned h = 0; h < 0x7bff; h++) {
        float low = half_to_float((uint16_t)h), high = half_to_float((uint16_t)(h + 1));
        float middle = low + (high - low) / 2; /* exact in float */
        CHECK_EQ(half_from_float(middle), h & 1 ? h + 1 : h);
        CHECK_EQ(half_from_float(nextafterf(middle, 0)), h);
        CHECK_EQ(half_from_float(nextafterf(middle, 1e9f)), h + 1);
        CHECK_EQ(half_from_float(-middle), (h & 1 ? h + 1 : h) | 0x8000);
    }
    CHECK_EQ(half_from_float(65519.996f), 0x7bff);
    CHECK_EQ(half_from_float(65520.0f), 0x7c00);
    CHECK_EQ(half_from_float(3.4e38f), 0x7c00);
    CHECK_EQ(half_from_float(-INFINITY), 0xfc00);
}

/* ---- Layers ---------------------------------------------------------------------------------- */

static int is_at(layer_match m, size_t a, size_t b, size_t c)
{
    return m.count == 3 && m.channels[0] == a && m.channels[1] == b && m.channels[2] == c;
}

static void layers_are_found_by_name(void)
{
    static const char *const names[] = {"B",        "G",   "R",   "albedo.B", "albedo.G",
                                        "albedo.R", "N.X", "N.Y", "N.Z",      "Z"};
    CHECK(is_at(layers_find(IMAGE_COLOR, names, 10), 2, 1, 0));
    CHECK(is_at(layers_find(IMAGE_ALBEDO, names, 10), 5, 4, 3));
    CHECK(is_at(layers_find(IMAGE_NORMAL, names, 10), 6, 7, 8));
    CHECK_EQ(layers_find(IMAGE_NORMAL, names, 8).count, 0); /* without N.Z */
    CHECK(is_at(layers_find_named("ALBEDO", names, 10), 5, 4, 3));
    CHECK(is_at(layers_find_named("Z,N.X,B", names, 10), 9, 6, 0));
    CHECK_EQ(layers_find_named("Z", names, 10).count, 1);
    CHECK_EQ(layers_find_named("Z,Q", names, 10).count, 0);
    CHECK_EQ(layers_find_named("B,G,R,Z", names, 10).count, 0);
    CHECK_EQ(layers_find_named("", names, 10).count, 3); /* the layer without a name */
}

static void layer_names_have_an_order(void)
{
    static const char *const names[] = {
        "View.Combined.R",         "View.Combined.G",         "View.Combined.B",
        "View.Noisy Image.R",      "View.Noisy Image.G",      "View.Noisy Image.B",
        "View.DiffCol.R",          "View.DiffCol.G",          "View.DiffCol.B",
        "View.Denoising Albedo.R", "View.Denoising Albedo.G", "View.Denoising Albedo.B"};
    CHECK(is_at(layers_find(IMAGE_COLOR, names, 12), 3, 4, 5));
    CHECK(is_at(layers_find(IMAGE_ALBEDO, names, 12), 9, 10, 11));
    CHECK(is_at(layers_find(IMAGE_ALBEDO, names, 9), 6, 7, 8));
    CHECK_EQ(layers_find(IMAGE_NORMAL, names, 12).count, 0);
}

static void layers_of_one_name_stay_together(void)
{
    static const char *const names[] = {"a.albedo.R", "a.albedo.G", "b.albedo.B", "b.albedo.G",
                                        "b.albedo.R", "xalbedo.R",  "xalbedo.G",  "xalbedo.B"};
    CHECK(is_at(layers_find(IMAGE_ALBEDO, names, 8), 4, 3, 2));
    CHECK_EQ(layers_find(IMAGE_ALBEDO, names + 5, 3).count, 0);
    CHECK(is_at(layers_find(IMAGE_COLOR, names + 5, 3), 0, 1, 2)); /* an unknown colour */
}

/* ---- Command lines --------------------------------------------------------------------------- */

typedef struct sample {
    int flag, number, word;
    float real;
    const char *text;
    char pair[32], rest[64];
} sample;

static int take_pair(void *settings, const char *const *v)
{
    snprintf(((sample *)settings)->pair, 32, "%s+%s", v[0], v[1]);
    return !strcmp(v[0], "bad");
}

static int take_rest(void *settings, const char *argument)
{
    strcat(((sample *)settings)->rest, argument);
    return 0;
}

#define AT(field) offsetof(sample, field)
static int parse(sample *s, const char *line)
{
    static const option_word words[] = {{"low l", 3}, {"high h", 7}, {NULL, 0}};
    static const option table[] = {
        HEADING("heading"),
        FLAG("f flag", flag, 5, ""),
        INT("n number", number, -2, 9, "N", ""),
        WORD("w", word, words, "low|high", ""),
        FLOAT("r", real, "X", ""),
        TEXT("t", text, "T", ""),
        CALL("p", take_pair, 2, "A B", ""),
    };
    static char copy[256];
    char *argv[32] = {"program"}, *word;
    int argc = 1;
    strcpy(copy, line);
    for (word = strtok(copy, " "); word; word = strtok(NULL, " "))
        argv[argc++] = word;
    memset(s, 0, sizeof *s);
    return options_parse(table, sizeof table / sizeof table[0], s, take_rest, argc, argv);
}

static void options_are_stored(void)
{
    sample s;
    CHECK_EQ(parse(&s, "-f a --number -2 ---w=h b -r 1e-3 --t --x -p 1 2 c"), 0);
    CHECK(s.flag == 5 && s.number == -2 && s.word == 7 && s.real == 1e-3f);
    CHECK_STR(s.text, "--x");
    CHECK_STR(s.pair, "1+2");
    CHECK_STR(s.rest, "abc");
    CHECK_EQ(parse(&s, ""), 0);
}

static void wrong_options_are_refused(void)
{
    static const char *const lines[] = {"-q",    "--",   "-",        "-n",    "-n 10",
                                        "-n 1x", "-n=",  "-f=1",     "-w lo", "-r inf",
                                        "-r",    "-p 1", "-p bad 1", "-t=",   "--numbers 1"};
    sample s;
    (void)!freopen("/dev/null", "w", stderr);
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++)
        if (!CHECK(parse(&s, lines[i]) != 0))
            printf("accepted: %s\n", lines[i]);
}

static void numbers_are_whole(void)
{
    int n = 77;
    CHECK(option_parse_int("12", 0, 20, &n) && n == 12);
    CHECK(!option_parse_int("", 0, 20, &n) && !option_parse_int("1.5", 0, 20, &n));
    CHECK(!option_parse_int("99999999999999999999", 0, 20, &n) && n == 12);
}

static void patterns_match_whole_texts(void)
{
    static const struct {
        const char *pattern, *text;
        int matches;
    } cases[] = {
        {"", "", 1},
        {"", "a", 0},
        {"a|b", "b", 1},
        {"a|b", "ab", 0},
        {"a*", "aaa", 1},
        {"a+b?", "aab", 1},
        {"a+", "", 0},
        {"(ab)*c", "ababc", 1},
        {"(a|b)+", "abba", 1},
        {"[a-c]+", "abcd", 0},
        {"[^a]b", "cb", 1},
        {"[]]", "]", 1},
        {"\\.", ".", 1},
        {"\\.", "a", 0},
        {"\\d\\w", "7_", 1},
        {"(a*)*b", "aaab", 1},
        {"(a*)*", "", 1},
        {".*x.*", "axb", 1},
        {"(a(b|c))*d", "abacd", 1},
        {"((a|ab)(c|bcd))d*", "abcd", 1},
        {"^a.*c$", "abc", 1},
        {"(^a|b$)+", "a", 1},
        {"a^b", "ab", 0},
        {"a$b", "ab", 0},
        {"\\^\\$\\{", "^${", 1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        if (!CHECK_EQ(pattern_matches(cases[i].pattern, cases[i].text), cases[i].matches))
            printf("%s against %s\n", cases[i].pattern, cases[i].text);
    CHECK(pattern_error("a(b") && pattern_error("*") && pattern_error("a)") && pattern_error("[a"));
    CHECK(pattern_error("a**") && pattern_error("a\\") && !pattern_error("(a|b)*c?"));
    CHECK(pattern_error("a{3}") && !pattern_error("^a$"));
}

/* ---- Sequences, JSON ------------------------------------------------------------------------- */

static void check_path(const char *pattern, int frame, const char *expected)
{
    char *path = sequence_path(pattern, frame);
    if (CHECK(path != NULL))
        CHECK_STR(path, expected);
    free(path);
}

static void frames_have_paths(void)
{
    sequence s;
    check_path("a/b.####.exr", 7, "a/b.0007.exr");
    check_path("b#.exr", 123, "b123.exr");
    check_path("b#.exr", SEQUENCE_NONE, "b#.exr");
    check_path("b%d.exr", SEQUENCE_NONE, "b%d.exr");
    check_path("b.%04d.exr", 7, "b.0007.exr");
    check_path("%d", 7, "7");
    check_path("dir#/b.exr", 7, "dir#/b.exr");
    check_path("100%.exr", 7, "100%.exr");
    check_path("%s%n.exr", 7, "%s%n.exr");
    CHECK(sequence_is_pattern("a#") && !sequence_is_pattern("a#/b") &&
          !sequence_is_pattern("%04x"));
    if (CHECK_EQ(sequence_parse(&s, "1,5-9x2,12"), 0)) {
        CHECK(s.count == 5 && s.frames[0] == 1 && s.frames[3] == 9 && s.frames[4] == 12);
        sequence_free(&s);
    }
    CHECK(sequence_parse(&s, "2-1") && sequence_parse(&s, "") && sequence_parse(&s, "1-2-3"));
    CHECK(!s.frames);
}

static void json_is_escaped(void)
{
    json j;
    memset(&j, 0, sizeof j);
    json_open(&j, NULL, '{');
    json_text(&j, "a\"b", "tab\t back\\ \xc3\xa4 bad\xff\xc3");
    json_number(&j, "n", 0.1);
    json_number(&j, "inf", INFINITY);
    json_number(&j, "big", 4294967296.0);
    json_open(&j, "list", '[');
    json_bool(&j, NULL, 1);
    /* Half of a pair, beyond U+10FFFF, in more bytes than needed; and the last ones before them. */
    json_text(&j, NULL, "\xed\xa0\x80 \xf4\x90\x80\x80 \xe0\x80\xaf \xf0\x8f\xbf\xbf");
    json_text(&j, NULL, "\xed\x9f\xbf \xf4\x8f\xbf\xbf \xe0\xa0\x80 \xf0\x90\x80\x80");
    json_open(&j, NULL, '{');
    json_close(&j, '}');
    json_close(&j, ']');
    json_close(&j, '}');
    CHECK_STR(j.text,
              "{\"a\\\"b\": \"tab\\u0009 back\\\\ \xc3\xa4 bad??\", \"n\": 0.1, \"inf\": null, "
              "\"big\": 4294967296, \"list\": [true, \"\?\?\? \?\?\?\? \?\?\? \?\?\?\?\", "
              "\"\xed\x9f\xbf \xf4\x8f\xbf\xbf \xe0\xa0\x80 \xf0\x90\x80\x80\", {}]}");
    free(j.text);
}

/* ---- Images ---------------------------------------------------------------------------------- */

static void comparison_counts_outliers(void)
{
    image a, b;
    image_error error;
    comparison c;
    if (!CHECK(!image_create(&a, 5, 1, 1, IMAGE_FLOAT, &error)) ||
        !CHECK(!image_create(&b, 5, 1, 1, IMAGE_HALF, &error)))
        return;
    static const float x[5] = {0, 1, 10, 1, 2}, y[5] = {0.015625f, 1.5f, 10.5f, NAN, 2};
    for (size_t i = 0; i < 5; i++) {
        image_set(&a, i, x[i]);
        image_set(&b, i, y[i]);
    }
    image_compare(&c, &a, &b, 1);
    CHECK_EQ(c.errors, 5); /* the average is not a number */
    image_set(&b, 3, 1);
    image_compare(&c, &a, &b, 1);
    CHECK(c.values == 5 && c.errors == 1 && c.shown == 1 && c.examples[0].index == 1);
    image_compare(&c, &a, &b, 0.01);
    CHECK(c.errors == 5 && c.shown == 1);
    image_compare(&c, &a, &b, 0);
    CHECK_EQ(c.shown, 3);
    image_destroy(&a);
    image_destroy(&b);
}

static void hash_is_fnv1a(void)
{
    image img;
    image_error error;
    if (!CHECK(!image_create(&img, 1, 1, 1, IMAGE_FLOAT, &error)))
        return;
    image_set(&img, 0, 1.0f); /* bytes 00 00 80 3f */
    CHECK_EQ(image_hash(&img), 0x1b587698u);
    image_destroy(&img);
}

static void srgb_curve(void)
{
    CHECK(srgb_encode(0) == 0 && fabsf(srgb_encode(1) - 1) < 1e-6f);
    CHECK(fabsf(srgb_encode(0.5f) - 0.735357f) < 1e-5f &&
          fabsf(srgb_decode(0.5f) - 0.214041f) < 1e-5f);
    for (int i = 0; i <= 1000; i++)
        CHECK(fabsf(srgb_decode(srgb_encode((float)i / 1000)) - (float)i / 1000) < 1e-6f);
}

static void outputs_appear_whole_or_not(void)
{
    static const char name[] = "test_parts_output.tmp";
    output_file out;
    char text[8] = "";
    FILE *file;
    remove(name);
    CHECK_EQ(output_open(&out, name), 0);
    fputs("new", out.stream);
    file = fopen(name, "r");
    CHECK(!file);
    output_discard(&out);
    CHECK_EQ(output_open(&out, name), 0);
    fputs("new", out.stream);
    CHECK_EQ(output_close(&out), 0);
    file = fopen(name, "r");
    if (CHECK(file != NULL)) {
        CHECK(fgets(text, 8, file) != NULL);
        fclose(file);
    }
    CHECK_STR(text, "new");
    CHECK(output_open(&out, "no/such/folder") != 0 && output_open(&out, ".") != 0);
    remove(name);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(half_to_float_and_back_is_exact);
    RUN(half_has_the_value_of_its_bits);
    RUN(half_rounds_to_nearest_even);
    RUN(layers_are_found_by_name);
    RUN(layer_names_have_an_order);
    RUN(layers_of_one_name_stay_together);
    RUN(options_are_stored);
    RUN(wrong_options_are_refused);
    RUN(numbers_are_whole);
    RUN(patterns_match_whole_texts);
    RUN(frames_have_paths);
    RUN(json_is_escaped);
    RUN(comparison_counts_outliers);
    RUN(hash_is_fnv1a);
    RUN(srgb_curve);
    RUN(outputs_appear_whole_or_not);
    return check_report();
}
