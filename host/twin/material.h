/* What surfaces are made of: for the eye, and for the laser's infrared. */
#ifndef SC_TWIN_MATERIAL_H
#define SC_TWIN_MATERIAL_H

#include "base/vec.h"

#include <stdbool.h>
#include <stdint.h>

enum material_kind {
    MATERIAL_MATT,   /* Lambert, with a weak gloss by f0 and roughness */
    MATERIAL_COATED, /* Lambert under a smooth clear coat: car paint, varnish, wet */
    MATERIAL_METAL,  /* reflects only; rgb is the reflectance */
    MATERIAL_GLASS,  /* a thin clear pane: reflects a little, lets the rest through unbent */
    MATERIAL_RETRO,  /* sends light back where it came from: signs, reflectors, plates */
    MATERIAL_EMITTER /* a lamp */
};

/* Procedural pattern, evaluated in the part's local frame. */
enum material_texture {
    TEXTURE_PLAIN,
    TEXTURE_ASPHALT,
    TEXTURE_CONCRETE,
    TEXTURE_PLASTER,
    TEXTURE_BRICK,
    TEXTURE_ASHLAR, /* stone blocks with joints */
    TEXTURE_MARBLE,
    TEXTURE_STONE, /* sandstone without joints */
    TEXTURE_PAINT, /* flakes and road dirt that grows towards z = 0 */
    TEXTURE_WOOD,
    TEXTURE_BARK,
    TEXTURE_LEAF,
    TEXTURE_GRASS,
    TEXTURE_CHECKER,   /* squares of scale_m in x and y, exact */
    TEXTURE_ROAD_MARK, /* worn paint over asphalt */
    TEXTURE_SIGN_WARN,
    TEXTURE_SIGN_STOP,
    TEXTURE_SIGN_LIMIT,
    TEXTURE_PLATE, /* number plate */
    TEXTURE_RUST,
    TEXTURE_CLOTH,
    TEXTURE_FLOOR, /* two colours of square tiles */
    TEXTURE_TYRE,
    TEXTURE_STRIPES, /* bands along z: cones, barriers */
    TEXTURE_DUMMY,   /* test dummy: markers on the joints */
    TEXTURE_DIRT,
    TEXTURE_BRUSHED,
    TEXTURE_WINDOWS, /* dark panes with lit rooms here and there */
    TEXTURE_ROOF,
    TEXTURE_VELVET
};

struct material {
    char name[24];
    enum material_kind kind;
    enum material_texture texture;
    float rgb[3], rgb2[3]; /* linear reflectance, main and second colour of the pattern */
    float albedo_ir;       /* Lambert reflectance at the laser's wavelength */
    float f0;              /* specular reflectance at normal incidence */
    float roughness;       /* of the specular lobe, 0 mirror .. 1 */
    float bump;            /* strength of the pattern's relief, 0..1, for the camera only */
    float scale_m;         /* size of the pattern's features */
    float transmission_ir; /* glass: part that passes a pane once */
    float retro;           /* retro-reflective gain over a white Lambert surface */
    float emission[3];
    uint32_t seed;
};

/* The surface at a point. */
struct material_sample {
    float rgb[3];
    float albedo_ir;
    float roughness, f0;
    float emission[3];
    struct vec3 bump; /* to be added to the unit normal, local frame */
};

/* Evaluates the pattern at p (local frame) with unit normal n (local frame). coarse: features finer
 * than a few millimetres, and the relief, are left out; enough for the laser's footprint and for
 * what is seen in a mirror, at a third of the cost. Any thread. */
void material_sample_at(const struct material *m, struct vec3 p, struct vec3 n, bool coarse,
                        struct material_sample *out);

/* Fresnel reflectance by Schlick's approximation (1994). */
static inline double material_fresnel(double f0, double cos_incidence) {
    double c = 1 - (cos_incidence < 0 ? 0 : cos_incidence > 1 ? 1 : cos_incidence);
    double c2 = c * c;
    return f0 + (1 - f0) * c2 * c2 * c;
}

/* The same for a rough surface, which does not become a mirror at grazing incidence (Lagarde 2011).
 */
static inline double material_fresnel_rough(double f0, double roughness, double cos_incidence) {
    double c = 1 - (cos_incidence < 0 ? 0 : cos_incidence > 1 ? 1 : cos_incidence);
    double c2 = c * c, top = 1 - roughness > f0 ? 1 - roughness : f0;
    return f0 + (top - f0) * c2 * c2 * c;
}

#endif
