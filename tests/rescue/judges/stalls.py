import sys,math,bisect
# stalls in drives: believed against true
W=3.0
tot=dict(windows=0,stallw=0)
eps=[];drive=[];grow=[]
for fn in sys.argv[1:]:
    order=[];L={}
    for l in open(fn):
        k=l[:2]
        w=l.split(None,2)
        if not w: continue
        if w[0]=='Y' and w[1] not in order: order.append(w[1])
        if w[0] in 'EP' and len(w)>2: L.setdefault(w[1],[]).append(l)
    for i,k in enumerate(order,1):
        T=[];PX=[]
        D=[]
        for l in L.get(k,[]):
            if l[0]=='P':
                a=l.split();T.append(float(a[2]));PX.append(tuple(map(float,a[3:6])))
            else:
                a=l.split()
                if len(a)>4 and a[3]=='Log' and a[4]=='D':
                    t=float(a[2]);v=a[5:]
                    D.append((t,float(v[0]),float(v[1]),float(v[2]),float(v[3]),v[4]=='true',v[5]=='true')+tuple(map(float,v[6:])))
                elif len(a)>4 and a[3]=='Log' and a[4] in 'BW': D.append((float(a[2]),a[4]))
        def true(t):
            j=bisect.bisect(T,t)
            if j==0: return PX[0]
            if j>=len(T): return PX[-1]
            u=(t-T[j-1])/(T[j]-T[j-1]) if T[j]>T[j-1] else 0
            p,q=PX[j-1],PX[j]
            return tuple(p[m]+u*(q[m]-p[m]) for m in range(3))
        # steps
        seg=[];segs=[]
        for d in D:
            if len(d)==2:
                if seg: segs.append((seg,d[1]));seg=[]
                continue
            if seg and (d[4]<seg[-1][4]-1e-6 or d[0]-seg[-1][0]>1.0):
                segs.append((seg,'-'));seg=[]
            seg.append(d)
        if seg: segs.append((seg,'-'))
        for seg,end in segs:
            # per step
            epi=None
            for a,b in zip(seg,seg[1:]):
                dt=b[0]-a[0]
                if dt<=0: continue
                bm=math.hypot(b[1]-a[1],b[2]-a[2])
                # window 1s true motion around
                p,q=true(a[0]-.3),true(b[0]+.3)
                tm=math.hypot(q[0]-p[0],q[1]-p[1])/(dt+.6)*dt
                drive.append((bm,tm))
                stall=bm/dt>.06 and tm/dt<.025
                if stall:
                    if epi is None: epi=[i,a[0],b[0],0,0,0,fn,end,p,0]
                    epi[2]=b[0];epi[3]+=bm;epi[4]+=tm
                    epi[9]=max(epi[9],b[15] if len(b)>15 else 0)
                    if b[6]: epi[5]=1
                else:
                    if epi and b[0]-epi[2]>.6:
                        eps.append(epi);epi=None
                if b[6] and epi: epi[5]=1;eps.append(epi);epi=None
                elif b[6]: eps.append([i,a[0],b[0],0,0,2,fn,end,p,0])
            if epi: eps.append(epi)
print('believed m %.1f true %.1f'%(sum(d[0] for d in drive),sum(d[1] for d in drive)))
e=[x for x in eps if x[3]>=.1]
print('episodes with >=.1 m believed',len(e),'metres',round(sum(x[3] for x in e),1),'held',sum(1 for x in e if x[5]==1), 'held without stall',sum(1 for x in eps if x[5]==2))
un=[x for x in e if x[5]==0]
print('not noticed',len(un),'metres %.1f'%sum(x[3] for x in un))
for lo,hi in((.1,.2),(.2,.4),(.4,.7),(.7,1),(1,9)):
    s=[x for x in un if lo<=x[3]<hi]; h=[x for x in e if x[5]==1 and lo<=x[3]<hi]
    print(lo,hi,'unnoticed',len(s),'m %.1f'%sum(x[3] for x in s),'held',len(h),'m %.1f'%sum(x[3] for x in h))
for x in sorted(un,key=lambda x:-x[3])[:25]: print(x[6][-7:-4],x[0],'t %.1f-%.1f believed %.2f true %.2f end %s since %.1f'%(x[1],x[2],x[3],x[4],x[7],x[9]))
