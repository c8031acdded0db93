/* The input doctor: says in words what looks wrong with the images given to the denoiser. */
#ifndef LULL_APPS_DOCTOR_H
#define LULL_APPS_DOCTOR_H

#include "imageio.h"

typedef enum finding_kind {
    FINDING_NONFINITE,      /* NaN or infinite values */
    FINDING_NEGATIVE,       /* radiance or albedo below 0 */
    FINDING_NORMAL_ENCODED, /* normals stored as n * 0.5 + 0.5; mended by decoding */
    FINDING_NORMAL_LENGTH,  /* normals that are not of unit length */
    FINDING_ALBEDO_ABOVE_ONE,
    FINDING_ALBEDO_BLACK,
    FINDING_LDR_AS_HDR, /* clipped at 1, or in the 256 steps of an 8-bit file, but called HDR */
    FINDING_HDR_AS_LDR, /* values above 1 will be clipped */
    FINDING_CORRELATED, /* neighbouring pixels share noise: a splatting filter, or already filtered
                         */
    FINDING_SHIFTED,    /* albedo or normals are displaced or mirrored against the colour */
    FINDING_PANORAMA,   /* left and right edge meet, in a picture twice as wide as high */
    FINDING_KINDS
} finding_kind;

typedef struct finding {
    finding_kind kind;
    image_role role;
    char text[200]; /* one sentence: what, how much, and what to do */
} finding;

#define FINDINGS_MAX 32

typedef struct findings {
    size_t count;
    finding list[FINDINGS_MAX];
} findings;

/* What the colour is said to be. */
typedef enum doctor_content {
    DOCTOR_HDR,
    DOCTOR_LDR,
    DOCTOR_SRGB,
    DOCTOR_SIGNED
} doctor_content;

/* Examines images of one size. Those that are absent are NULL. */
void doctor_examine(findings *out, const image *color, doctor_content content, const image *albedo,
                    const image *normal);

/* Whether an image, the albedo if there is one, looks like a panorama of a whole sphere; adds to
 * what was found. */
void doctor_examine_edges(findings *out, const image *img);

/* Short name of a kind for programs: "normals-encoded", ... */
const char *doctor_kind_name(finding_kind kind);

#endif
