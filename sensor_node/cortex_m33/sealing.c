/* AES-256-GCM (FIPS 197, NIST SP 800-38D): one table of 1 KiB, and the hash four bits at a time. */
#include "message.h"

static uint8_t substitute[256];
static uint32_t mixed[256];

static uint32_t rotated(uint32_t x, int bits) { return x >> bits | x << (32 - bits); }

static uint8_t doubled(uint8_t x) { return (uint8_t)(x << 1 ^ (x & 0x80 ? 0x1B : 0)); }

static void make_tables(void)
{
    uint8_t p = 1, q = 1;
    do { /* p runs through the field's powers of 3, q through their inverses */
        p ^= doubled(p);
        q ^= q << 1, q ^= q << 2, q ^= q << 4;
        if (q & 0x80)
            q ^= 0x09;
        uint8_t x = q ^ (uint8_t)(q << 1 | q >> 7) ^ (uint8_t)(q << 2 | q >> 6);
        substitute[p] = x ^ (uint8_t)(q << 3 | q >> 5) ^ (uint8_t)(q << 4 | q >> 4) ^ 0x63;
    } while (p != 1);
    substitute[0] = 0x63;
    for (int k = 0; k < 256; k++) {
        uint32_t s = substitute[k], s2 = doubled((uint8_t)s);
        mixed[k] = s2 << 24 | s << 16 | s << 8 | (s2 ^ s);
    }
}

static uint32_t word(const uint8_t *bytes)
{
    uint32_t x;
    memcpy(&x, bytes, 4);
    return __builtin_bswap32(x);
}

static void put_word(uint8_t *bytes, uint32_t x)
{
    x = __builtin_bswap32(x);
    memcpy(bytes, &x, 4);
}

static uint32_t substituted(uint32_t x)
{
    return (uint32_t)substitute[x >> 24] << 24 | (uint32_t)substitute[x >> 16 & 255] << 16 |
           (uint32_t)substitute[x >> 8 & 255] << 8 | substitute[x & 255];
}

static uint32_t column(uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    return mixed[a >> 24] ^ rotated(mixed[b >> 16 & 255], 8) ^ rotated(mixed[c >> 8 & 255], 16) ^
           rotated(mixed[d & 255], 24);
}

static uint32_t last_column(uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    return substituted((a & 0xFF000000) | (b & 0xFF0000) | (c & 0xFF00) | (d & 0xFF));
}

static void encrypt(const key_t *key, const uint8_t in[16], uint8_t out[16])
{
    const uint32_t *k = key->round_key;
    uint32_t a = word(in) ^ k[0], b = word(in + 4) ^ k[1];
    uint32_t c = word(in + 8) ^ k[2], d = word(in + 12) ^ k[3];
    for (int round = 1; round < 14; round++) {
        k += 4;
        uint32_t e = column(a, b, c, d) ^ k[0], f = column(b, c, d, a) ^ k[1];
        uint32_t g = column(c, d, a, b) ^ k[2], h = column(d, a, b, c) ^ k[3];
        a = e, b = f, c = g, d = h;
    }
    put_word(out, last_column(a, b, c, d) ^ k[4]);
    put_word(out + 4, last_column(b, c, d, a) ^ k[5]);
    put_word(out + 8, last_column(c, d, a, b) ^ k[6]);
    put_word(out + 12, last_column(d, a, b, c) ^ k[7]);
}

static uint64_t long_word(const uint8_t *bytes) { return (uint64_t)word(bytes) << 32 | word(bytes + 4); }

/* What four bits that are shifted out of the hash put back at its other end. */
static const uint16_t REDUCED[16] = {0x0000, 0x1C20, 0x3840, 0x2460, 0x7080, 0x6CA0, 0x48C0, 0x54E0,
                                     0xE100, 0xFD20, 0xD940, 0xC560, 0x9180, 0x8DA0, 0xA9C0, 0xB5E0};

static void multiply(const key_t *key, uint8_t x[16])
{
    int nibble = x[15] & 15;
    uint64_t high = key->high[nibble], low = key->low[nibble];
    for (int k = 31; k-- > 0;) {
        nibble = k & 1 ? x[k >> 1] & 15 : x[k >> 1] >> 4;
        int out = low & 15;
        low = high << 60 | low >> 4;
        high = high >> 4 ^ (uint64_t)REDUCED[out] << 48;
        high ^= key->high[nibble], low ^= key->low[nibble];
    }
    put_word(x, (uint32_t)(high >> 32)), put_word(x + 4, (uint32_t)high);
    put_word(x + 8, (uint32_t)(low >> 32)), put_word(x + 12, (uint32_t)low);
}

void expand_key(key_t *key, const uint8_t secret[32])
{
    if (!substitute[0])
        make_tables();
    uint32_t *k = key->round_key;
    uint8_t constant = 1;
    for (int j = 0; j < 8; j++)
        k[j] = word(secret + 4 * j);
    for (int j = 8; j < 60; j++) {
        uint32_t x = k[j - 1];
        if (j % 8 == 0) {
            x = substituted(rotated(x, 24)) ^ (uint32_t)constant << 24;
            constant = doubled(constant);
        } else if (j % 8 == 4) {
            x = substituted(x);
        }
        k[j] = k[j - 8] ^ x;
    }
    uint8_t hash[16] = {0};
    encrypt(key, hash, hash);
    uint64_t high = long_word(hash), low = long_word(hash + 8);
    key->high[0] = key->low[0] = 0;
    for (int j = 8; j > 0; j >>= 1) {
        key->high[j] = high, key->low[j] = low;
        uint64_t out = low & 1;
        low = high << 63 | low >> 1;
        high = high >> 1 ^ (out ? 0xE1ULL << 56 : 0);
    }
    for (int j = 2; j < 16; j <<= 1)
        for (int k = 1; k < j; k++) {
            key->high[j + k] = key->high[j] ^ key->high[k];
            key->low[j + k] = key->low[j] ^ key->low[k];
        }
}

static void add(uint8_t *to, const uint8_t *from, int size)
{
    if (size < 16) {
        for (int k = 0; k < size; k++)
            to[k] ^= from[k];
        return;
    }
    for (int k = 0; k < 16; k += 4) {
        uint32_t one, other;
        memcpy(&one, to + k, 4), memcpy(&other, from + k, 4);
        one ^= other;
        memcpy(to + k, &one, 4);
    }
}

static void hash(const key_t *key, uint8_t state[16], const uint8_t *bytes, int length)
{
    for (int k = 0; k < length; k += 16) {
        int size = length - k < 16 ? length - k : 16;
        add(state, bytes + k, size);
        multiply(key, state);
    }
}

void seal(const key_t *key, const uint8_t nonce[12], const uint8_t *aad, int aad_length,
          uint8_t *text, int length, uint8_t tag[16])
{
    uint8_t counter[16], stream[16], state[16] = {0}, sizes[16] = {0};
    memcpy(counter, nonce, 12);
    for (int k = 0, number = 2; k < length; k += 16, number++) {
        put_word(counter + 12, (uint32_t)number);
        encrypt(key, counter, stream);
        int size = length - k < 16 ? length - k : 16;
        add(text + k, stream, size);
    }
    hash(key, state, aad, aad_length);
    hash(key, state, text, length);
    put_word(sizes + 4, (uint32_t)aad_length * 8), put_word(sizes + 12, (uint32_t)length * 8);
    hash(key, state, sizes, 16);
    put_word(counter + 12, 1);
    encrypt(key, counter, tag);
    for (int j = 0; j < 16; j++)
        tag[j] ^= state[j];
}
