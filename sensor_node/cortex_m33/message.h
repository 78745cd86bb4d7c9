/* A statement in CBOR, and its sealing with AES-256-GCM. */
#ifndef MESSAGE_H
#define MESSAGE_H

#include "channel.h"

typedef struct {
    const uint8_t *layout;
    int64_t boot, sequence, earliest, latest;
    double coverage;
} head_t;

/* Gives the message's bytes. */
int write_peak(uint8_t *out, const head_t *head, const event_t *event);

typedef struct {
    uint32_t round_key[60];
    uint64_t high[16], low[16];
} key_t;

void expand_key(key_t *key, const uint8_t secret[32]);
void seal(const key_t *key, const uint8_t nonce[12], const uint8_t *aad, int aad_length,
          uint8_t *text, int length, uint8_t tag[16]);

#endif
