import sys,math,collections,pickle
# load(FILE) -> {key: [segments]}, segment = list of ('S', B, rays, A, true) / ('W', pose, rays, true)
def load(fn):
    out=collections.OrderedDict();true={};cur={};PS=collections.defaultdict(list)
    for l in open(fn):
        w=l.split(None,5)
        if not w: continue
        if w[0]=='P':
            w=l.split(); true[w[1]]=tuple(map(float,w[3:6])); PS[w[1]].append((float(w[2]),)+true[w[1]])
        elif w[0]=='E' and w[3]=='Log':
            k=w[1];m=l
            q=m.split('"')[1] if '"' in m else m.split('Log',1)[1]
            toks=q.split()
            if not toks: continue
            t=float(w[2]);tag=None
            for i,x in enumerate(toks):
                if x in('B','Q','A','W','F'): tag=x;toks=toks[i+1:];break
            if tag is None: continue
            segs=out.setdefault(k,[[]])
            rays=lambda ts:[tuple([float(a[0]),float(a[1]),{'h':0,'k':1,'r':2}[a[2]],float(a[3].replace('inf','9')),float(a[4])]) for a in (x.rstrip('"').split(',') for x in ts)]
            if tag=='F':
                if segs[-1]: segs.append([])
            elif tag=='B': cur[k]=(tuple(map(float,toks[:3])),[],true[k],t)
            elif tag=='Q': cur[k][1].extend(rays(toks))
            elif tag=='A': b=cur[k];segs[-1].append(('S',b[0],b[1],tuple(map(float,toks[:3])),b[2],b[3]))
            elif tag=='W': segs[-1].append(('W',tuple(map(float,toks[:3])),rays(toks[3:]),true[k],t))
    import bisect
    lag=LAG
    for k,segs in out.items():
        ts=[p[0] for p in PS[k]]
        for g in segs:
            for i,r in enumerate(g):
                if r[0]=='W':
                    t=r[4]-lag;j=bisect.bisect(ts,t)
                    if 0<j<len(ts):
                        a,b=PS[k][j-1],PS[k][j];f=(t-a[0])/(b[0]-a[0]) if b[0]>a[0] else 0
                        dh=(b[3]-a[3]+math.pi)%(2*math.pi)-math.pi
                        g[i]=('W',r[1],r[2],(a[1]+f*(b[1]-a[1]),a[2]+f*(b[2]-a[2]),a[3]+f*dh),r[4])
    return out
LAG=float(__import__('os').environ.get('LAG','0'))
if __name__=='__main__':
    d=load(sys.argv[1]);pickle.dump(d,open(sys.argv[2],'wb'))
    for k,s in d.items(): print(k,[ (sum(x[0]=='S' for x in g),sum(x[0]=='W' for x in g)) for g in s])
