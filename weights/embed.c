/* Build-time tool: turns files into one C file of arrays.
 *
 *     embed DIRECTORY OUTPUT.c               the weights files that builtin.def names
 *     embed --text NAME OUTPUT.c FILE...     sources in C, one after the other, as a string
 *
 * Each row BUILTIN(id, file, ...), file a string relative to DIRECTORY, gives
 *
 *     const unsigned char lull_weights_<id>[];       aligned to 64 bytes
 *     const size_t lull_weights_<id>_bytes;
 *
 * A file named by several rows is stored once for each. Sources give
 *
 *     const char NAME[];                             NUL-terminated
 *
 * without comments and indentation, but with all of their lines, so that compilers' messages name
 * the right ones. Their strings must not hold what looks like a comment.
 *
 * Errors: one line on stderr, exit status 1,
 * and no output file. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct {
    const char *id, *file;
} builtins[] = {
#define BUILTIN(id, ...) {#id, FIRST(__VA_ARGS__, 0)},
#define FIRST(file, ...) file
#include "builtin.def"
#undef BUILTIN
    {NULL, NULL},
};

static int fail(const char *what, const char *why)
{
    fprintf(stderr, "embed: %s: %s\n", what, why);
    return 0;
}

/* What of a source matters. */
enum { NONE, OPENING, INSIDE };
typedef struct filter {
    int is_on, before, is_comment, is_indented;
} filter;

/* 1 if byte c stays, after those that were passed before; next: the one after it. */
static int stays(filter *f, int c, int next)
{
    int ends = f->is_comment && f->before == '*' && c == '/';

    if (!f->is_on)
        return 1;
    if (!f->is_comment && c == '/' && next == '*') {
        f->is_comment = OPENING;
        return 0;
    }
    f->before = f->is_comment == OPENING ? 0 : c; /* its asterisk ends no comment */
    if (c == '\n')
        return f->is_indented = 1;
    if (f->is_comment) {
        f->is_comment = ends ? NONE : INSIDE;
        return 0;
    }
    f->is_indented = f->is_indented && c == ' ';
    return !f->is_indented;
}

/* Writes the bytes of a file, or of what matters of a source, as numbers. Returns how many, or 0
 * after a message. */
static unsigned long put_bytes(FILE *out, const char *path, int is_source)
{
    FILE *in = fopen(path, "rb");
    filter f = {is_source, 0, NONE, 1};
    unsigned long bytes = 0;
    int c, next;

    if (!in) {
        fail(path, strerror(errno));
        return 0;
    }
    for (c = getc(in); c != EOF; c = next) {
        next = getc(in);
        if (stays(&f, c, next))
            fprintf(out, "%s%d,", bytes++ % 24 ? "" : "\n", c);
    }
    if (ferror(in) || !bytes) {
        fail(path, bytes ? "cannot read" : "empty file");
        bytes = 0;
    }
    fclose(in);
    return bytes;
}

/* Writes the array of one weights file. Returns 1, or 0 after a message. */
static int embed(FILE *out, const char *directory, const char *id, const char *file)
{
    char path[4096];
    unsigned long bytes;

    if (snprintf(path, sizeof path, "%s/%s", directory, file) >= (int)sizeof path)
        return fail(file, "path too long");
    fprintf(out, "\nextern const unsigned char lull_weights_%s[];\n", id);
    fprintf(out, "extern const size_t lull_weights_%s_bytes;\n", id);
    fprintf(out, "ALIGNED const unsigned char lull_weights_%s[] = {", id);
    bytes = put_bytes(out, path, 0);
    fprintf(out, "\n};\nconst size_t lull_weights_%s_bytes = %luu;\n", id, bytes);
    return bytes != 0;
}

static int embed_builtins(FILE *out, const char *directory)
{
    int ok = 1;

    fputs("/* Made by weights/embed.c from the files that weights/builtin.def names. */\n"
          "#include <stddef.h>\n\n"
          "#if defined(__GNUC__)\n#define ALIGNED __attribute__((aligned(64)))\n"
          "#else\n#define ALIGNED\n#endif\n",
          out);
    for (size_t i = 0; ok && builtins[i].id; i++)
        ok = embed(out, directory, builtins[i].id, builtins[i].file);
    return ok;
}

static int embed_texts(FILE *out, const char *name, char **files, int count)
{
    int ok = 1;

    fprintf(out, "/* Made by weights/embed.c. */\nextern const char %s[];\n", name);
    fprintf(out, "const char %s[] = {", name);
    for (int i = 0; ok && i < count; i++)
        ok = put_bytes(out, files[i], 1) != 0;
    fputs("0};\n", out);
    return ok;
}

int main(int argc, char **argv)
{
    const int is_text = argc > 4 && !strcmp(argv[1], "--text");
    const char *path = is_text ? argv[3] : argv[2];
    char temporary[4096];
    FILE *out;
    int ok;

    if (argc != 3 && !is_text) {
        fprintf(stderr, "usage: embed DIRECTORY OUTPUT.c\n"
                        "       embed --text NAME OUTPUT.c FILE...\n");
        return 1;
    }
    if (snprintf(temporary, sizeof temporary, "%s.new", path) >= (int)sizeof temporary)
        return !fail(path, "path too long");
    out = fopen(temporary, "w");
    if (!out)
        return !fail(temporary, strerror(errno));
    ok = is_text ? embed_texts(out, argv[2], argv + 4, argc - 4) : embed_builtins(out, argv[1]);
    if (fclose(out) && ok)
        ok = fail(temporary, "cannot write");
    remove(path); /* rename does not replace on every system */
    if (ok && rename(temporary, path))
        ok = fail(path, strerror(errno));
    if (!ok)
        remove(temporary);
    return !ok;
}
